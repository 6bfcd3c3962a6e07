"""A session on the ROS graph: each step as messages with the stamps of its samples."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64, String

from app.bridge import messages, topics
from app.bridge.constraint import ConstraintBuilder
from app.bridge.diagnostics import Diagnostics
from app.bridge.frame_tree import ALONE, FrameTree, Voice
from app.bridge.heartbeat import Heartbeat
from app.bridge.markers import Markers
from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.bridge.replay_scene import ReplayScene
from app.bridge.tf.broadcaster import tf_message
from app.fixture import FixtureDecision, MarginState
from app.geometry import Stamp
from app.session import StepResult

NODE_NAME = "marginguard"


class SessionPublisher:
    """``with SessionPublisher(scene) as ros: ... ros.publish(session.step(frame))``.

    What does not change (static frames, the robot's description, grey surfaces) is latched on
    construction. ``heartbeat_hz`` repeats the constraint in a thread between steps, for a session
    that follows real time; None sends one constraint a step. ``voice`` tells what is left to
    others, ``counts`` what diagnostics say of a live source. `publish` is for one thread.
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
        voice: Voice = ALONE,
        counts: Callable[[], Mapping[str, int]] | None = None,
    ) -> None:
        self._voice = voice
        with ExitStack() as opening:
            self.ros = opening.enter_context(
                RosNode(name, namespace=namespace, ros_args=ros_args, domain_id=domain_id)
            )
            self._publishers = {
                topic.name: self.ros.publisher(topic)
                for topic in topics.EVERY_STEP
                if self._speaks_on(topic)
            }
            self._surfaces_publisher = self.ros.publisher(topics.MARKERS)
            self._frame_tree = FrameTree(scene.static_edges, voice)
            self._edges_left_out: set[tuple[str, str]] = set()
            self._diagnostics = Diagnostics(counts)
            self._markers = Markers(scene)
            # Serialised once a state: a tumour of 80k triangles takes long to convert.
            self._surfaces = {
                state: serialize_message(self._markers.surfaces(state)) for state in MarginState
            }
            self._surfaces_state: MarginState | None = None
            self._constraint_builder = ConstraintBuilder(scene)
            self._last_state: int | None = None
            self._fault_seq = 0
            self._latch(scene)
            self._heartbeat = Heartbeat(self._send_constraint, heartbeat_hz)
            self._open = opening.pop_all()
            self._open.callback(self._heartbeat.close)

    def publish(self, step: StepResult) -> None:
        """Send everything that ``step`` found; the clock first, so that no sample is from later."""
        if self._voice.clock:
            self._send(topics.CLOCK, messages.clock_message(step.frame.stamp))
        self._publish_frames(step)
        for sample in step.frame.joints if self._voice.robot else ():
            self._send(topics.JOINT_STATES, messages.joint_state_message(sample))
        self._heartbeat.newest(self._constraint_builder.message(step.decision))
        self._publish_margin(step.decision)
        report = self._diagnostics.report(step)
        if report is not None:
            self._send(topics.DIAGNOSTICS, report)

    @property
    def fault_seq(self) -> int:
        """``seq`` of the constraint with which the state last became UNKNOWN."""
        return self._fault_seq

    def close(self) -> None:
        """End the heartbeat and leave the ROS graph. A second call does nothing."""
        self._open.close()

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
        self._send(topics.MARKERS, self._markers.words(decision))
        self._show_surfaces(decision.state)

    def _show_surfaces(self, state: MarginState) -> None:
        if state is not self._surfaces_state:
            self._surfaces_publisher.publish(self._surfaces[state])
            self._surfaces_state = state

    def _latch(self, scene: ReplayScene) -> None:
        never = Stamp(0)
        self._latched = [self.ros.publisher(topics.TF_STATIC)]
        self._latched[0].publish(tf_message((edge, never) for edge in scene.static_edges))
        if scene.robot_description is not None:
            self._latched.append(self.ros.publisher(topics.ROBOT_DESCRIPTION))
            self._latched[1].publish(String(data=scene.robot_description))
        self._show_surfaces(MarginState.UNKNOWN)

    def _send(self, topic: Topic, message: object) -> None:
        self._publishers[topic.name].publish(message)

    def _send_constraint(self, message: FixtureConstraint, seq: int) -> None:
        message.seq = seq
        if message.state != self._last_state and message.state == int(MarginState.UNKNOWN):
            self._fault_seq = seq
        self._last_state = message.state
        self._send(topics.CONSTRAINT, message)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
