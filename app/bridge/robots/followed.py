"""One robot on the ROS graph: its description, and where its links are now."""

from collections.abc import Callable

from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.bridge.robots.description import DescriptionListener, DescriptionSource
from app.bridge.robots.joint_follower import JointFollower
from app.bridge.robots.settings import RobotSettings
from app.bridge.robots.state import RobotState
from app.bridge.robots.tf_follower import TfFollower
from app.bridge.tf import TransformBuffer
from app.geometry import NS_PER_S
from app.robot import Robot

MAX_JOINT_STATE_BYTES = 1 << 18
"""Thousands of joints; a longer message is no robot."""


class FollowedRobot:
    """A robot that is given, or described on the graph, and follows tf or joint states.

    ``buffer`` is filled by the caller's `TfListener`, shared by all robots. Any number of them can
    live on one node, each with its own `RobotSettings`. When the description changes the robot
    starts anew from it; ``changed(robot)`` is called then, in another thread. ``received()`` is
    called in the node's thread after every joint state; for tf the listener has the same.
    """

    def __init__(
        self,
        ros: RosNode,
        settings: RobotSettings,
        buffer: TransformBuffer,
        described_by: Robot | DescriptionSource,
        *,
        joint_states: str = "",
        changed: Callable[[Robot], None] | None = None,
        received: Callable[[], None] | None = None,
    ) -> None:
        self.settings = settings
        self.refused = 0
        self.description: DescriptionListener | None = None
        self._buffer = buffer
        self._from_joints = bool(joint_states)
        self._changed = changed
        self._received = received
        self._robot: Robot | None = None
        self._follower: TfFollower | JointFollower | None = None
        if self._from_joints:
            topic = Topic(settings.topic(joint_states), JointState, qos_profile_sensor_data)
            ros.subscribe(topic, self._take_joints, raw=True)
        if isinstance(described_by, Robot):
            self._follow(described_by)
        else:
            self.description = DescriptionListener(ros, settings, described_by, self._follow)

    @property
    def robot(self) -> Robot | None:
        """The newest description that could be loaded, None before the first."""
        return self._robot

    def state(self, now_ns: int) -> RobotState:
        """Where the links are at the newest time that is known of all; ``now_ns`` tells its age."""
        follower = self._follower
        if follower is None:
            problem = self.description.problem if self.description is not None else ""
            return RobotState("", (), None, None, True, (problem,))
        return follower.state(now_ns)

    def _follow(self, robot: Robot) -> None:
        # The robot first: whoever sees a state, in another thread, looks for whose it is.
        self._robot = robot
        self._follower = (
            JointFollower(robot, self.settings, self._buffer)
            if self._from_joints
            else TfFollower(robot, self.settings, self._buffer)
        )
        if self._changed is not None:
            self._changed(robot)

    def _take_joints(self, raw: bytes) -> None:
        follower = self._follower
        if not isinstance(follower, JointFollower):
            return
        if len(raw) > MAX_JOINT_STATE_BYTES:
            self.refused += 1
            return
        message: JointState = deserialize_message(raw, JointState)
        stamp = message.header.stamp
        follower.take(message.name, message.position, stamp.sec * NS_PER_S + stamp.nanosec)
        if self._received is not None:
            self._received()
