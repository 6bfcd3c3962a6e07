"""Process that publishes the description of a robot with plain rclpy.

``by`` is "parameter" or "topic". Each line on stdin is a new description.
"""

import json
import sys
import threading

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from tests.bridge.peers import spin

by, text = sys.argv[1:]
rclpy.init()
node = rclpy.create_node("robot_state_publisher")
if by == "parameter":
    node.declare_parameter("robot_description", text, ParameterDescriptor())
else:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    describe = node.create_publisher(String, "robot_description", latched)
    describe.publish(String(data=text))


def redescribe():
    for line in sys.stdin:
        text = json.loads(line)
        if by == "parameter":
            node.set_parameters([Parameter("robot_description", value=text)])
        else:
            describe.publish(String(data=text))


threading.Thread(target=redescribe, daemon=True).start()
spin(node)
