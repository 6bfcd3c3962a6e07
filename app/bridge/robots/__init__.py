"""Robots on the ROS graph: their descriptions and the poses of their links."""

from app.bridge.robots.description import DescriptionListener, DescriptionSource, MeshMapSource
from app.bridge.robots.errors import FollowError
from app.bridge.robots.followed import FollowedRobot
from app.bridge.robots.joint_follower import JointFollower
from app.bridge.robots.settings import JOINT_STATES, RobotSettings
from app.bridge.robots.state import RobotState
from app.bridge.robots.tf_follower import TfFollower

__all__ = [
    "JOINT_STATES",
    "DescriptionListener",
    "DescriptionSource",
    "FollowError",
    "FollowedRobot",
    "JointFollower",
    "MeshMapSource",
    "RobotSettings",
    "RobotState",
    "TfFollower",
]
