"""Play a recording onto the ROS graph, as the drivers of a tracker and a robot would publish it.

Recorded poses must not be mistaken for those of a patient. A playback announces itself on
`app.bridge.topics.PLAYBACK`, and it does not share its topics with another publisher.
"""

import time
from collections import deque
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from threading import Event

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.publisher import Publisher
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.live.sources import CountedSubscription
from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.message_origin import Origin
from app.bridge.messages import diagnostic_status, joint_state_message, playback_text
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import INCOMING, STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS, TrackerPublisher
from app.case import CaseManifest, PlayedSamples
from app.case.messages.message_values import PoseValues
from app.case.messages.ros_messages import TF_MESSAGE
from app.session import REFERENCE

DISCOVERY_S = 4.0
"""Time after which all nodes are known: Fast DDS announces each of them every 3 s at least."""

_REPLY_S = 1.0
"""Time in which a node that was just discovered sends its name, and a playback what it plays."""

_POLL_S = 0.05
_MAX_REMEMBERED = 4096
_MAX_CHARS = 200
_EXPECTED = "expected no publisher besides the playback: recorded and measured poses must not mix"

NODE_NAME = "marginguard_tracker"

REPORT_S = 1.0
"""Period of the status on ``/diagnostics``."""


class SoleSource:
    """Raises `BridgeError` from `check` when another node publishes on one of ``names``.

    Endpoints of a playback that was killed stay on the graph for up to 20 s. A running playback
    answers each new subscription with its announcement and a killed one does not, so such endpoints
    are tolerated.

    Several nodes share ``/tf``. There another publisher is one that sends a pose of ``frames`` with
    a stamp that was not passed to `sent`. A live session that repeats the samples of the playback
    on ``/tf`` keeps their stamps.
    """

    def __init__(self, ros: RosNode, names: Sequence[str], frames: Collection[str]) -> None:
        self._ros = ros
        self._names = tuple(names)
        self._frames = frozenset(frames)
        self._known: set[bytes] = set()
        self._announced: str | None = None
        self._tf_problem = ""
        self._sent: set[int] = set()
        self._sent_in_order: deque[int] = deque()
        self._watching = True
        ros.subscribe(topics.PLAYBACK, self._take_announcement)
        CountedSubscription(ros, replace(topics.TF, qos=INCOMING), TF_MESSAGE, self._take_tf)

    def wait_for_discovery(self, stop: Event) -> bool:
        """Wait until all publishers on the graph are known and check them; False once ``stop``.

        Call it before the first publisher of this node is created.
        """
        ends_s = time.monotonic() + DISCOVERY_S
        silent: set[bytes] = set()
        while True:
            if stop.wait(_POLL_S):
                return False
            if self._announced is not None:
                raise BridgeError(
                    f"another playback runs on this graph: {self._announced}; expected one at most"
                )
            others = self._others()
            same_name = {_gid(info) for _, info in others if info.node_name == self._node_name}
            if same_name - silent:
                ends_s = max(ends_s, time.monotonic() + _REPLY_S)
                silent |= same_name
            is_over = time.monotonic() >= ends_s
            self._refuse(
                (topic, info)
                for topic, info in others
                if _gid(info) not in silent and (is_over or info.node_name != UNKNOWN_NODE)
            )
            if is_over:
                self._known |= silent
                self._watching = False
                return True

    def add_own(self) -> None:
        """Accept this node's publishers: call it as soon as they are created, one per topic."""
        others = self._others()
        for name in self._names:
            own = [i for topic, i in others if topic == name and i.node_name == self._node_name]
            if len(own) == 1:  # more: another playback has started at the same time
                self._known.add(_gid(own[0]))
        self.check()

    def sent(self, stamps_ns: Iterable[int]) -> None:
        """Remember the stamps of samples that are about to be published on ``/tf``."""
        for ns in stamps_ns:
            self._sent.add(ns)
            self._sent_in_order.append(ns)
        while len(self._sent_in_order) > _MAX_REMEMBERED:
            self._sent.discard(self._sent_in_order.popleft())

    def check(self) -> None:
        """Raise `BridgeError` if there is another publisher now."""
        others = self._others()
        ends_s = time.monotonic() + _REPLY_S
        # The name of a node arrives after its first endpoint; nothing is published meanwhile.
        while time.monotonic() < ends_s and any(i.node_name == UNKNOWN_NODE for _, i in others):
            time.sleep(_POLL_S)
            others = self._others() or others
        self._refuse(others)

    @property
    def _node_name(self) -> str:
        return str(self._ros.node.get_name())

    def _others(self) -> list[tuple[str, TopicEndpointInfo]]:
        """Topics and their publishers that are not known to be harmless."""
        return [
            (name, info)
            for name in self._names
            for info in self._ros.node.get_publishers_info_by_topic(name)
            if _gid(info) not in self._known
        ]

    def _refuse(self, others: Iterable[tuple[str, TopicEndpointInfo]]) -> None:
        problem = self._tf_problem
        for topic, info in others:
            node = f"node {info.node_namespace.rstrip('/')}/{info.node_name}"
            if info.node_name == UNKNOWN_NODE:
                node = "another node"
            problem = f"{topic}: {node} publishes on it too"
        if problem:
            raise BridgeError(f"{problem}; {_EXPECTED}")

    def _take_announcement(self, message: String) -> None:
        if self._watching:
            self._announced = message.data[:_MAX_CHARS]

    def _take_tf(self, poses: tuple[PoseValues, ...], _: Origin) -> None:
        for pose in poses:
            if pose.source in self._frames and pose.ns not in self._sent:
                self._tf_problem = f"/tf: another node publishes poses of {pose.source!r}"


def _gid(info: TopicEndpointInfo) -> bytes:
    return bytes(info.endpoint_gid)


class PlaybackNode:
    """Publishes the samples of a case as the drivers of its tracker and its robot would.

    Poses go to ``pose_topic``, valid ones also to ``/tf``, joints to the topic that the case names.
    There is no session and no constraint. `start` announces the playback on
    `app.bridge.topics.PLAYBACK` before the first sample can be received. Every second the status
    ``marginguard: playback`` (WARN) on ``/diagnostics`` repeats it. `start` and `publish` raise
    `BridgeError` if another node publishes poses or joints of the case too (`SoleSource`).
    """

    def __init__(
        self, ros: RosNode, manifest: CaseManifest, pose_topic: str = TRACKED_TRANSFORMS.name
    ) -> None:
        self.poses = 0
        self.joints = 0
        self._ros = ros
        self._manifest = manifest
        self._pose_topic = Topic(pose_topic, TRACKED_TRANSFORMS.type, TRACKED_TRANSFORMS.qos)
        robot = manifest.robot
        self._joint_topic: Topic | None = None
        if robot is not None and robot.joint_states is not None:
            self._joint_topic = Topic(robot.joint_states, JointState, STREAM)
        self._robot: Publisher | None = None
        self._sole = SoleSource(
            ros,
            [topic.name for topic in (self._pose_topic, self._joint_topic) if topic is not None],
            {manifest.tool.frame, manifest.tumor.frame, REFERENCE},
        )

    @property
    def topic_names(self) -> tuple[str, ...]:
        """Topics of the samples."""
        joints = () if self._joint_topic is None else (self._joint_topic.name,)
        return (self._pose_topic.name, topics.TF.name, *joints)

    def start(self, stop: Event) -> bool:
        """Wait until all nodes are known, announce the playback; False once ``stop`` is set."""
        if not self._sole.wait_for_discovery(stop):
            return False
        # The announcement is created first: other nodes discover endpoints in this order.
        announcement = self._ros.publisher(topics.PLAYBACK)
        announcement.publish(String(data=playback_text(self._manifest)))
        self._tracker = TrackerPublisher(self._ros, self._pose_topic)
        if self._joint_topic is not None:
            self._robot = self._ros.publisher(self._joint_topic)
        self._sole.add_own()
        self._diagnostics = self._ros.publisher(topics.DIAGNOSTICS)
        self._ros.node.create_timer(REPORT_S, self._report)
        return True

    def publish(self, samples: PlayedSamples) -> None:
        """Publish ``samples``, unless there is another publisher."""
        self._sole.check()
        self._sole.sent({sample.stamp.ns for sample in samples.poses})
        self._tracker.publish(samples.poses)
        if self._robot is not None:
            for joints in samples.joints:
                self._robot.publish(joint_state_message(joints))
        self.poses += len(samples.poses)
        self.joints += len(samples.joints)

    def _report(self) -> None:
        provenance = self._manifest.provenance
        values = {
            "case": self._manifest.name,
            "provenance.kind": provenance.kind,
            "provenance.source": provenance.source,
            "provenance.licence": provenance.licence,
            "poses": self.poses,
            "joint samples": self.joints,
        }
        text = "PLAYBACK: poses from a recording"
        status = diagnostic_status("playback", DiagnosticStatus.WARN, text, values)
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._ros.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
