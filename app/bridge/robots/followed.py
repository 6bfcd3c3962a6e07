"""A robot on the ROS graph: its description and the current poses of its links."""

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
"""Room for thousands of joints."""


class FollowedRobot:
    """Follows the links of a robot through tf or joint states.

    ``described_by`` is the robot, or the source of its description on the graph. ``joint_states``
    is the topic to follow; if it is empty the links follow tf. The caller's `TfListener` fills
    ``buffer``, which all robots share. A new description restarts the robot and calls
    ``changed(robot)`` in another thread. ``received()`` is called in the node's thread after every
    joint state; for tf use that of the listener.
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
        """Robot of the latest valid description; None before the first."""
        return self._robot

    def state(self, now_ns: int) -> RobotState:
        """Poses of the links at their latest common time; ``now_ns`` decides if they are stale."""
        follower = self._follower
        if follower is None:
            problem = self.description.problem if self.description is not None else ""
            return RobotState("", (), None, None, True, (problem,))
        return follower.state(now_ns)

    def _follow(self, robot: Robot) -> None:
        # Set the robot first: another thread that reads a state then finds its robot.
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
