"""The page of a live session: a client of a live node, which this command may start itself."""

import argparse
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from itertools import chain
from secrets import token_hex
from typing import TYPE_CHECKING

from app.cli.process import SignalState, prompt_process
from app.cli.ros import load_ros
from app.files.child_process import step_back
from app.geometry import InputError

if TYPE_CHECKING:
    from app.bridge.displays import LiveChild, SessionClient
    from app.bridge.node import RosNode
    from app.files.volume_file import Volume
    from app.session import StepResult
    from app.viewer import LiveFeed, LiveSteps, MouseHand, Viewer
    from app.viewer.drawing.render_loop import MakeScheduler
    from app.workflow import ApproachGhost, NeedleGuide


@contextmanager
def live_page(
    options: argparse.Namespace,
    received: SignalState,
    *,
    scheduler: "MakeScheduler | None" = None,
    client: bool = False,
    volume: "Volume | None" = None,
    plans: "tuple[ApproachGhost, NeedleGuide] | None" = None,
) -> Iterator["Viewer | None"]:
    """A page of the live node ``options.node``, or of one that is started for ``options.config``.

    Such a node ends with the context. Yields None if a signal came before the first step.
    ``scheduler`` draws the pictures; a benchmark replaces it. ``client``: the browser draws the
    scene. ``volume`` is cut through the tool's tip; ``plans`` are shown beside the steps.
    """
    load_ros("which a live session needs")
    from app.bridge import RosNode
    from app.bridge.displays.remote_operator import PAGE_NODE

    name = f"{PAGE_NODE}_{token_hex(3)}"
    with ExitStack() as stack:
        child = None if options.config is None else stack.enter_context(_child(options, name))
        from app.viewer import Viewer  # noqa: F401  (slow to load: while the node starts)

        step_back()  # behind the guard, which draws nothing
        ros = stack.enter_context(RosNode(name, namespace=options.namespace))
        session = stack.enter_context(_client(options, ros, child))
        received.stops(session.stop)
        steps = stack.enter_context(closing(session.steps()))
        first = next(steps, None)
        if first is None or session.operator is None:
            yield None
            return
        yield stack.enter_context(
            _shown(
                options, ros, session, chain([first], steps), child,
                scheduler=scheduler, client=client, volume=volume, plans=plans,
            )
        )  # fmt: skip


@contextmanager
def _child(options: argparse.Namespace, page: str) -> Iterator["LiveChild"]:
    """A live node for ``options.config``, whose log is printed here."""
    from app.bridge.displays import LiveChild

    namespace = f"/{options.namespace.strip('/')}".rstrip("/")
    arguments = [f"--config={options.config}", f"--display={namespace}/{page}"]
    arguments += [f"--package-dir={folder}" for folder in options.package_dirs]
    arguments += [] if options.tool is None else [f"--tool={options.tool}"]
    for option in ("namespace", "audit", "cases"):
        value = getattr(options, option)
        arguments += [f"--{option}={value}"] if value else []
    child = LiveChild(arguments, _print_line)
    try:
        yield child
    finally:
        child.close()


def _print_line(line: str) -> None:
    # This command has told the reach of ROS, and it reports an error that ends the node.
    if not line.startswith(("marginguard: error: ", "ROS discovery ")):
        print(line, file=sys.stderr, flush=True)


@contextmanager
def _client(
    options: argparse.Namespace, ros: "RosNode", child: "LiveChild | None"
) -> Iterator["SessionClient"]:
    """The client of the session; it waits for its first step while ``child`` runs."""
    from app.bridge.displays import SessionClient
    from app.bridge.publishing.session_publisher import NODE_NAME

    def check(_silent_s: float) -> None:
        if child is not None and child.ended and client.operator is None:
            raise InputError(child.error)

    node = NODE_NAME if options.node is None else options.node
    client = SessionClient(ros, node, waiting=check, own=child is not None)
    if child is None:
        print(f"the live node: {client.node}", file=sys.stderr)
    try:
        yield client
    finally:
        client.close()


@contextmanager
def _shown(
    options: argparse.Namespace,
    ros: "RosNode",
    session: "SessionClient",
    steps: Iterator["StepResult"],
    child: "LiveChild | None",
    *,
    scheduler: "MakeScheduler | None",
    client: bool,
    volume: "Volume | None",
    plans: "tuple[ApproachGhost, NeedleGuide] | None",
) -> Iterator["Viewer"]:
    """The page, with the steps on their way to it within the context."""
    from app.bridge.world_client import TRACKER, WORLD, WorldListener
    from app.runtime import SimulatedWorld, stop_surface
    from app.viewer import (
        LiveFeed,
        LiveOperator,
        LiveSteps,
        LiveTimeline,
        MouseHand,
        SceneView,
        Title,
        Viewer,
        ViewStateBuilder,
    )
    from app.viewer.drawing.scene_view import Part
    from app.viewer.plan_part import planned_parts

    def silence() -> str:
        return (child.ended if child is not None else "") or session.silence

    operator_of_session = session.operator
    assert operator_of_session is not None  # the first step has come
    content = operator_of_session.content
    surface = stop_surface(content)
    feed = LiveFeed(ViewStateBuilder(content, surface), time.monotonic_ns, silence)
    title = Title(content.name, live=True, images=session.images, volume=volume)
    operator = LiveOperator(feed.list_request)
    hand = None if options.hand is None else MouseHand(time.monotonic_ns)
    world = None if options.world is None else SimulatedWorld(WORLD, TRACKER, time.time_ns)
    bodies = () if world is None else (Part.BODIES,)
    goal = None
    if plans is not None:
        from app.bridge.displays import ApproachRequest
        from app.workflow import GoalPose

        goal = GoalPose(ApproachRequest(ros).plan, plans[0].choose)
    viewer = Viewer(
        SceneView(content, added=(*bodies, *planned_parts(plans))),
        feed,
        LiveTimeline(),
        title,
        operator=operator,
        scheduler=scheduler,
        client=client,
        hand=hand,
        world=world,
        plans=plans,
        goal=goal,
    )
    feed.call_on_change(viewer.wake)
    if plans is not None:
        from app.bridge.displays import ExecutedPlan

        ghost = plans[0]

        def executes(plan: str) -> None:
            ghost.execute(plan)
            viewer.wake()

        ExecutedPlan(ros, executes)
    with prompt_process(), ThreadPoolExecutor(max_workers=1) as workers:
        workflow = viewer.workflow
        session.needs_every = lambda: workflow is not None and workflow.is_recording
        followed = LiveSteps(feed, content, surface, workers, workflow)
        operator.connect(operator_of_session)
        thread = threading.Thread(
            target=_follow, args=(session, steps, followed, feed), name="session"
        )
        thread.start()
        try:
            if world is not None:
                WorldListener(ros, options.world, world)
            with _published(hand, options.hand, feed, content.tip_frame):
                yield viewer
        finally:
            session.stop()
            thread.join()


def _follow(
    session: "SessionClient",
    steps: Iterator["StepResult"],
    followed: "LiveSteps",
    feed: "LiveFeed",
) -> None:
    """Take the steps; when they end or cannot be used, the page shows why and stays grey."""
    why = "the page has ended"
    try:
        for step in steps:
            if session.operator is not None:
                followed.put(step, session.operator, session.delay_ns)
    except Exception as error:
        why = f"the session cannot be shown: {error}"
        raise
    finally:
        feed.end(why)


@contextmanager
def _published(
    hand: "MouseHand | None", topic: str, feed: "LiveFeed", frame: str
) -> Iterator[None]:
    """Publish the force of ``hand`` on ``topic`` within the context."""
    if hand is None:
        yield
        return
    from app.bridge import RosNode
    from app.bridge.world_client import HAND_NODE, HandPublisher

    with RosNode(HAND_NODE) as ros:
        HandPublisher(ros, topic, frame, lambda: hand.force_n(feed.now()), clock_ns=time.time_ns)
        yield
