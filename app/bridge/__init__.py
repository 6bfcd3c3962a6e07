"""ROS 2: what a session finds, sent to the ROS graph. The only room that imports rclpy.

`app.bridge.topics` is the table of what is published, `app.bridge.messages` that of the units.
Call `prepare_environment` before the first node: it keeps discovery on this machine.
"""

from app.bridge.environment import prepare_environment
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.player_services import PlayerServices
from app.bridge.publishing.frame_tree import PublishPolicy
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.replay_node import replay_node

__all__ = [
    "BridgeError",
    "PlayerServices",
    "PublishPolicy",
    "RosNode",
    "SessionPublisher",
    "prepare_environment",
    "replay_node",
]
