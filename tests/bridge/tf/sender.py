"""Process that publishes one transform with plain rclpy, then waits to be killed."""

import json
import sys

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import edge_message

parent, child, stamp_ns = json.loads(sys.argv[1])
rclpy.init()
node = rclpy.create_node("sender")
publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
while publisher.get_subscription_count() < 1:
    rclpy.spin_once(node, timeout_sec=0.05)
edge = edge_message(TransformStamped(), parent, child, (0.0, 0.0, 0.0), (0, 0, 0, 1), stamp_ns)
publisher.publish(TFMessage(transforms=[edge]))
sys.stdin.read()
