"""A live session with all that it has on the ROS graph, for the command and whoever shows it."""

import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

from app.bridge.control import (
    GuidancePublisher,
    MarginParameterServer,
    OperatorServices,
    SessionChanges,
    TwistLimiter,
)
from app.bridge.live.joints import listen_to_joints
from app.bridge.live.rearming import RearmService
from app.bridge.live.source import source_of
from app.bridge.node import RosNode
from app.bridge.publishing.frame_tree import PublishPolicy
from app.bridge.publishing.prepared_shapes import PreparedShapes
from app.bridge.publishing.replay_scene import ReplayScene, scene_of
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.qos import INCOMING
from app.bridge.tf import TransformBuffer
from app.bridge.tf.listener import TfListener
from app.case import Case, LiveCase, TfSourceEntry
from app.session import (
    LiveSession,
    Session,
    SessionSetup,
    StepResult,
    guidance_parameters,
    limiter_parameters,
    tumor_motion_parameters,
)


@dataclass(frozen=True, slots=True, eq=False)
class LiveNode:
    """``live`` steps, ``changes`` and ``margins`` change it; made by `guarding`."""

    live: LiveSession
    changes: SessionChanges
    margins: MarginParameterServer
    _publisher: SessionPublisher
    _twists: TwistLimiter
    _guidance: GuidancePublisher | None
    _told: set[str] = field(default_factory=set)

    def steps(self) -> Generator[StepResult]:
        """Publish each step as it happens, and yield it; ends with ``live.stop``.

        The last word is then that of a rest, also after an error: no motion, no force and hold.
        """
        try:
            # Closed at once: an error would else keep the session from being changed or asked.
            with closing(self.live.steps()) as steps:
                for step in steps:
                    self._say(step)
                    yield step
        finally:
            self._twists.forbid()
            try:
                if self._guidance is not None:
                    self._guidance.rest()
            finally:
                with self.live.between_steps():
                    self._publisher.constraints.rest("inactive")

    def _say(self, step: StepResult) -> None:
        # What it is about comes first; what is sent meanwhile may grow.
        about = step.frames_problem.partition(":")[0]
        if about and about not in self._told:
            self._told.add(about)
            self._publisher.ros.node.get_logger().warning(step.frames_problem)
        if self._publisher.publish(step, self.live.spent_ns()):
            stale_after_ns = self.changes.scene.margins.stale_after_ns
            self._twists.allow(step, stale_after_ns, self.live.spent_ns())
        else:
            self.live.hold()
            self._twists.forbid()
        if self._guidance is not None:
            self._guidance.publish(step)


@dataclass(frozen=True, slots=True)
class SessionOutputs:
    """Whoever speaks by the margins, the tumour or the registration that are replaced."""

    publisher: SessionPublisher
    twists: TwistLimiter

    def use(self, scene: ReplayScene, shapes: PreparedShapes | None = None) -> None:
        """What the last step allowed was by those before: no motion up to the next one."""
        self.twists.forbid()
        self.publisher.use(scene, shapes)


@contextmanager
def guarding(
    config: LiveCase,
    case: Case,
    setup: SessionSetup,
    *,
    namespace: str,
    constraint_hz: float,
    tip_only: bool,
    ros: RosNode | None = None,
) -> Iterator[LiveNode]:
    """Join the graph: listen to the source that ``config`` names, serve the operator.

    With ``ros`` through that node, and in its own thread; whose node it is takes back the services
    and subscriptions. ``case`` and ``setup`` are those of ``config``, the tumour repaired.
    """
    entry = config.source
    limits, guides = limiter_parameters(config), guidance_parameters(config)
    setup = replace(setup, tumor_motion=tumor_motion_parameters(config))
    live = LiveSession(
        Session(setup),
        host_ns=_host_clock(config.stamps_of_host),
        stamps_of_host=config.stamps_of_host,
        edges=entry.edges if isinstance(entry, TfSourceEntry) else (),
    )
    counted: list[Callable[[], Mapping[str, int]]] = [live.left_out]
    # What the tracker's and the robot's own nodes say is not said again.
    voice = PublishPolicy(clock=False, measured=not isinstance(entry, TfSourceEntry), robot=False)
    scene = scene_of(case, setup, tip_only=tip_only, with_robot=False)
    with SessionPublisher(
        scene,
        namespace=namespace,
        heartbeat_hz=constraint_hz,
        voice=voice,
        counts=lambda: {name: n for counts in counted for name, n in counts().items()},
        ros=ros,
    ) as publisher:
        RearmService(publisher.ros, publisher.constraints, live.between_steps)
        buffer = TransformBuffer()
        TfListener(publisher.ros, buffer, clock=False, qos=INCOMING)
        twists = TwistLimiter(publisher.ros, buffer, parameters=limits)
        changes = SessionChanges(live.between_steps, SessionOutputs(publisher, twists), scene)
        margins = MarginParameterServer(publisher.ros, setup.margins, changes.set_margins)
        OperatorServices(publisher.ros, changes)
        guidance = None if guides is None else GuidancePublisher(publisher.ros, guides)
        source = source_of(publisher.ros, entry, live.add)
        counted += [
            source.counts,
            lambda: {"callbacks that failed": publisher.ros.failures},
            lambda: {f"twists refused: {why}": n for why, n in dict(twists.refused).items()},
        ]
        robot = case.manifest.robot
        if robot is not None and robot.joint_states is not None:
            offset_ns = case.manifest.clock.offset_robot_to_tracker_ns
            add_joints = partial(live.add_joints, of_host=config.joints_of_host)
            joints = listen_to_joints(publisher.ros, robot.joint_states, offset_ns, add_joints)
            counted.append(joints.counts)
        try:
            yield LiveNode(live, changes, margins, publisher, twists, guidance)
        finally:
            margins.close()
            twists.close()
            source.close()


def _host_clock(stamps_of_host: bool) -> Callable[[], int]:
    """ROS time where stamps are of this host; otherwise one that NTP does not set back."""
    if stamps_of_host:
        return time.time_ns
    began_ns = time.time_ns() - time.monotonic_ns()
    return lambda: began_ns + time.monotonic_ns()
