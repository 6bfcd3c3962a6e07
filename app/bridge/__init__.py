"""ROS 2 interface of a session. The only package that imports rclpy.

`app.bridge.topics` lists the published topics, `app.bridge.messages` the units of the messages.
Call `prepare_environment` before the first node; it restricts discovery to this machine.
"""

from app.bridge.environment import prepare_environment
from app.bridge.node import RosNode
from app.bridge.publishing.serialized import PublishPolicy
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.replay_node import PlayerServices, replay_node
from app.bridge.ros_errors import BridgeError
from app.bridge.session_bag import SessionBag

__all__ = [
    "BridgeError",
    "PlayerServices",
    "PublishPolicy",
    "RosNode",
    "SessionBag",
    "SessionPublisher",
    "prepare_environment",
    "replay_node",
]
