"""A session on the ROS graph: each step as messages with the stamps of its samples."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Self

from rclpy.publisher import Publisher
from std_msgs.msg import Float64, String

from app.bridge import messages, topics
from app.bridge.control.constraint_stream import ConstraintStream
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.publishing.constraint import ConstraintBuilder
from app.bridge.publishing.diagnostics import Diagnostics
from app.bridge.publishing.frame_tree import ALONE, FrameTree, PublishPolicy
from app.bridge.publishing.prepared_shapes import PreparedShapes
from app.bridge.publishing.replay_scene import ReplayScene
from app.bridge.qos import Topic
from app.bridge.tf.broadcaster import tf_message
from app.fixture import FixtureDecision, MarginState, Reason
from app.geometry import Stamp, stale_in_ns
from app.session import StepResult

NODE_NAME = "marginguard"

_NOTHING_KNOWN = FixtureDecision(
    state=MarginState.UNKNOWN,
    reasons=(Reason.STARTING,),
    proximity=None,
    margin=None,
    constraint=None,
    hold=True,
    stamp=None,
    seq=0,
)


class SessionPublisher:
    """``with SessionPublisher(scene) as ros: ... ros.publish(session.step(frame))``.

    What does not change (static frames, the robot's description, grey surfaces) is latched on
    construction. ``heartbeat_hz`` repeats the constraint in a thread between steps, for a session
    that follows real time; None sends one constraint a step. ``voice`` tells what is left to
    others, ``counts`` what diagnostics say of a live source. `publish` and `use` are for one
    thread. With ``ros`` it speaks through a node that is there already, and stays there;
    it is closed in that node's own thread then.
    """

    def __init__(
        self,
        scene: ReplayScene,
        *,
        name: str = NODE_NAME,
        namespace: str = "",
        ros_args: Sequence[str] = (),
        domain_id: int | None = None,
        heartbeat_hz: float | None = None,
        voice: PublishPolicy = ALONE,
        counts: Callable[[], Mapping[str, int]] | None = None,
        ros: RosNode | None = None,
    ) -> None:
        self._voice = voice
        self._scene = scene
        self._opened: list[Publisher] = []
        self._surfaces_state: MarginState | None = None
        with ExitStack() as opening:
            self.ros = ros or opening.enter_context(
                RosNode(name, namespace=namespace, ros_args=ros_args, domain_id=domain_id)
            )
            if ros is not None:
                opening.callback(self._leave)
            self._publishers = {
                topic.name: self._publisher(topic)
                for topic in topics.EVERY_STEP
                if self._speaks_on(topic)
            }
            self._surfaces_publisher = self._publisher(topics.MARKERS)
            self._static_publisher = self._publisher(topics.TF_STATIC)
            self._edges_left_out: set[tuple[str, str]] = set()
            self._diagnostics = Diagnostics(counts)
            self._constraint_builder = ConstraintBuilder(scene)
            self._shapes = PreparedShapes(scene)
            self._latch(scene)
            if scene.robot_description is not None:
                description = self._publisher(topics.ROBOT_DESCRIPTION)
                description.publish(String(data=scene.robot_description))
            self.constraints = ConstraintStream(
                self._publishers[topics.CONSTRAINT.name], heartbeat_hz
            )
            opening.callback(self.constraints.close)
            self._open = opening.pop_all()

    def publish(self, step: StepResult, spent_ns: int = 0) -> bool:
        """Send everything that ``step`` found; the clock first, so that no sample is from later.

        ``spent_ns``: how long ago its frame was the present, on a clock that is not ours.
        False when it came too late: the constraint before has been told to be stale meanwhile,
        this one is sent on hold, and the session has to latch that (`Session.hold`).
        """
        if self._voice.clock:
            self._send(topics.CLOCK, messages.clock_message(step.frame.stamp))
        self._publish_frames(step)
        for sample in step.frame.joints if self._voice.robot else ():
            self._send(topics.JOINT_STATES, messages.joint_state_message(sample))
        in_time = self.constraints.newest(
            self._constraint_builder.message(step.decision), lasts_ns=self._lasts_ns(step, spent_ns)
        )
        self._publish_margin(step.decision)
        report = self._diagnostics.report(step, self._scene.margins.stale_after_ns)
        if report is not None:
            self._send(topics.DIAGNOSTICS, report)
        return in_time

    def use(self, scene: ReplayScene, shapes: PreparedShapes | None = None) -> None:
        """Go on with other margins, another tumour or registration from the next step on.

        Of another tumour or registration nothing is known up to that step, and that is said now.
        ``shapes`` are those of ``scene``, made before because that takes long; None where tumour
        and tool stay as they are. Raises `BridgeError` for those of another scene. The robot's
        description stays as it was.
        """
        shapes = shapes or self._shapes
        if not shapes.are_of(scene):
            raise BridgeError("the shapes that were prepared are not those of the scene")
        before, self._scene = self._scene, scene
        self._constraint_builder.use(scene)
        if shapes is not self._shapes or scene.static_edges != before.static_edges:
            self._shapes = shapes
            # First of all: the planes of what was there before are no way to retreat from this.
            message = self._constraint_builder.message(_NOTHING_KNOWN)
            speaks = self.constraints.forget(message)
            self._latch(scene)
            if speaks:
                self._publish_margin(_NOTHING_KNOWN)

    def close(self) -> None:
        """End the heartbeat and leave the ROS graph. A second call does nothing."""
        self._open.close()

    def _publisher(self, topic: Topic) -> Publisher:
        self._opened.append(self.ros.publisher(topic))
        return self._opened[-1]

    def _leave(self) -> None:
        for publisher in self._opened:
            self.ros.withdraw(publisher)

    def _lasts_ns(self, step: StepResult, spent_ns: int) -> int | None:
        """For how long a heartbeat may repeat the constraint of ``step``.

        None for one that allows no approach anyway, and for a time of ours, which can be paused.
        """
        decision = step.decision
        if self._voice.clock or decision.state is MarginState.UNKNOWN or decision.stamp is None:
            return None
        limits = self._scene.margins.freshness_limits
        return max(0, stale_in_ns(decision.stamp.ns, step.frame.stamp.ns, limits) - spent_ns)

    def _speaks_on(self, topic: Topic) -> bool:
        if topic is topics.CLOCK:
            return self._voice.clock
        return self._voice.robot or topic is not topics.JOINT_STATES

    def _publish_frames(self, step: StepResult) -> None:
        edges = self._frame_tree.news(step)
        if edges:
            self._send(topics.TF, tf_message(edges))
        for edge, reason in self._frame_tree.left_out.items():
            if edge not in self._edges_left_out:
                self._edges_left_out.add(edge)
                self.ros.node.get_logger().warning(
                    f"{edge[0]} -> {edge[1]} is not sent to tf: {reason}"
                )

    def _publish_margin(self, decision: FixtureDecision) -> None:
        distance_mm = math.nan
        if decision.state is not MarginState.UNKNOWN and decision.proximity is not None:
            distance_mm = float(decision.proximity.signed_distance_mm)
        self._send(topics.MARGIN_MM, Float64(data=distance_mm))
        self._send(topics.MARGIN_COLOR, messages.color_message(decision.state.color))
        self._send(topics.MARKERS, self._shapes.words(decision))
        self._show_surfaces(decision.state)

    def _show_surfaces(self, state: MarginState) -> None:
        if state is not self._surfaces_state:
            self._surfaces_publisher.publish(self._shapes.surfaces(state))
            self._surfaces_state = state

    def _latch(self, scene: ReplayScene) -> None:
        """Say what stays the same for as long as ``scene`` does; the surfaces are grey again."""
        never = Stamp(0)
        self._frame_tree = FrameTree(scene.static_edges, self._voice)
        self._static_publisher.publish(tf_message((edge, never) for edge in scene.static_edges))
        self._surfaces_state = None
        self._show_surfaces(MarginState.UNKNOWN)

    def _send(self, topic: Topic, message: object) -> None:
        self._publishers[topic.name].publish(message)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
