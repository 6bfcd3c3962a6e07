"""Process that publishes one transform with plain rclpy, then waits to be killed."""

import json
import sys

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

parent, child, stamp_ns = json.loads(sys.argv[1])
rclpy.init()
node = rclpy.create_node("sender")
publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
while publisher.get_subscription_count() < 1:
    rclpy.spin_once(node, timeout_sec=0.05)
transform = TransformStamped(child_frame_id=child)
transform.header.frame_id = parent
transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(stamp_ns, 10**9)
publisher.publish(TFMessage(transforms=[transform]))
sys.stdin.read()
