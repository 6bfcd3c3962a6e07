"""A playback on the ROS graph: its publishers, its announcement and its diagnostics."""

from threading import Event

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.messages import joint_state_message, playback_text
from app.bridge.node import RosNode
from app.bridge.playback.sole_source import SoleSource
from app.bridge.qos import STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS, TrackerPublisher
from app.case import CaseManifest, PlayedSamples
from app.session import REFERENCE

NODE_NAME = "marginguard_tracker"

REPORT_S = 1.0
"""Period of the status on ``/diagnostics``."""


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
            "poses": str(self.poses),
            "joint samples": str(self.joints),
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN,
            name="marginguard: playback",
            message="PLAYBACK: poses from a recording",
            hardware_id="",
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._ros.node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
