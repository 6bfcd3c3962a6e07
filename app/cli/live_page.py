"""The page of a live session, which runs in a thread of its own beside it."""

import argparse
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from app.cli.prompt_process import prompt_process
from app.cli.ros import load_bridge, print_reach
from app.cli.signals import SignalState

if TYPE_CHECKING:
    from app.bridge.live import LiveNode
    from app.files.volume_file import Volume
    from app.runtime import SimulatedWorld
    from app.viewer import LiveFeed, MouseHand, Viewer
    from app.viewer.drawing.pictures import MakeScheduler

CONSTRAINT_HZ = 100.0
"""Rate at which the constraint is repeated. Drawing the page leaves no time for 1 kHz."""


@contextmanager
def live_page(
    options: argparse.Namespace,
    received: SignalState,
    *,
    scheduler: "MakeScheduler | None" = None,
    client: bool = False,
    hand_topic: str | None = None,
    simulation: str | None = None,
    volume: "Volume | None" = None,
) -> Iterator["Viewer"]:
    """A page for the session of ``options.config``, which runs within the context.

    A signal during the preparation ends the process at once. ``scheduler`` draws the pictures;
    a benchmark replaces it. ``client``: the browser draws the scene. ``hand_topic``: where the
    force of a mouse that drags the tool is published. ``simulation``: the node of the simulated
    world whose bodies are shown and edited. ``volume`` is cut through the tool's
    tip.
    """
    with received.ends_at_once():
        load_bridge("which a live session needs")
        print_reach()
        from app.bridge.live import live_node
        from app.bridge.world_editor import TRACKER, WORLD
        from app.runtime import (
            RobotRegistration,
            SimulatedWorld,
            ToolCalibration,
            prepare_live,
            stop_surface,
        )
        from app.viewer import (
            LiveFeed,
            LiveOperator,
            LiveOutput,
            LiveTimeline,
            MouseHand,
            SceneView,
            Title,
            Viewer,
            ViewStateBuilder,
        )

        prepared = prepare_live(
            options.config, package_dirs=options.package_dirs, tip_only=options.tip_only
        )
        for note in prepared.case.notes():
            print(note, file=sys.stderr)
        content, setup = prepared.content, prepared.setup
        surface = stop_surface(content)
        builder = ViewStateBuilder(setup, content, surface)
        feed = LiveFeed(builder, setup.margins.stale_after_ns, time.monotonic_ns)
        images = prepared.live_images()
        title = Title(content.name, live=True, images=images, volume=volume)
        operator_thread = ThreadPoolExecutor(max_workers=3)
        operator = LiveOperator(operator_thread)
        calibration = ToolCalibration(content)
        registration = None if content.robot is None else RobotRegistration(content)
        hand = None if hand_topic is None else MouseHand(time.monotonic_ns)
        world = None if simulation is None else SimulatedWorld(WORLD, TRACKER, time.time_ns)
        viewer = Viewer(
            SceneView(content, has_bodies=world is not None),
            feed,
            LiveTimeline(),
            title,
            operator=operator,
            scheduler=scheduler,
            client=client,
            hand=hand,
            calibration=calibration,
            registration=registration,
            world=world,
        )
        feed.call_on_change(viewer.wake)
    with prompt_process(), operator_thread, ThreadPoolExecutor(max_workers=1) as workers:
        guides = [each for each in (calibration, registration) if each is not None]
        output = LiveOutput(feed, content, surface, workers, operator, guides)
        with live_node(
            prepared,
            namespace=options.namespace,
            constraint_hz=CONSTRAINT_HZ,
            outputs=(output,),
            audit=options.audit,
            cases=options.cases,
            images=images,
        ) as node:
            node.commands.requests.listen(feed.list_request)
            operator.connect(node.commands, node.set_margins)
            thread = threading.Thread(target=_run, args=(node, feed), name="session")
            thread.start()
            try:
                with (
                    _published(hand, hand_topic, feed, content.tip_frame),
                    _followed(world, simulation),
                ):
                    yield viewer
            finally:
                node.stop()
                thread.join()


@contextmanager
def _published(
    hand: "MouseHand | None", topic: str | None, feed: "LiveFeed", frame: str
) -> Iterator[None]:
    """Publish the force of ``hand`` on ``topic`` within the context."""
    with ExitStack() as stack:
        if hand is not None and topic is not None:
            from app.bridge import RosNode
            from app.bridge.hand_publisher import HAND_NODE, HandPublisher

            ros = stack.enter_context(RosNode(HAND_NODE))
            HandPublisher(
                ros, topic, frame, lambda: hand.force_n(feed.now()), clock_ns=time.time_ns
            )
        yield


@contextmanager
def _followed(world: "SimulatedWorld | None", simulation: str | None) -> Iterator[None]:
    """Receive ``world`` from the node ``simulation``, and send its edits, within the context."""
    with ExitStack() as stack:
        if world is not None and simulation is not None:
            from app.bridge import RosNode
            from app.bridge.world_listener import PAGE_NODE, WorldListener

            WorldListener(stack.enter_context(RosNode(PAGE_NODE)), simulation, world)
        yield


def _run(node: "LiveNode", feed: "LiveFeed") -> None:
    """Take the steps; when the session ends or fails, the page shows why and stays grey."""
    why = "the session has ended"
    try:
        for _ in node.steps():
            pass
    except Exception as error:
        why = f"the session has failed: {error}"
        raise
    finally:
        feed.end(why)
