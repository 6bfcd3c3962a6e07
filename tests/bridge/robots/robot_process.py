"""Process that publishes a robot with plain rclpy: description, joint states, tf of one joint.

The position of the joint is ``rate * (stamp - start)``, so that the expected position follows from
a stamp. Each line on stdin is a new description.
"""

import json
import math
import sys
import threading

import rclpy
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import edge_message, spin

settings = json.loads(sys.argv[1])
rclpy.init()
node = rclpy.create_node("robot_state_publisher", namespace=settings["namespace"])
description = String(data=settings["urdf"])
if settings["by"] == "parameter":
    node.declare_parameter("robot_description", description.data, ParameterDescriptor())
else:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    describe = node.create_publisher(String, "robot_description", latched)
    describe.publish(description)
joints = node.create_publisher(JointState, "joint_states", QoSProfile(depth=10))
tf = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))


def move():
    now = node.get_clock().now()
    angle = settings["rate"] * (now.nanoseconds - settings["start_ns"]) * 1e-9
    message = JointState(name=["turn"], position=[angle])
    message.header.stamp = now.to_msg()
    joints.publish(message)
    turn = (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
    parent, child = settings["prefix"] + "base", settings["prefix"] + "arm"
    ns = now.nanoseconds
    edge = edge_message(TransformStamped(), parent, child, (0.25, 0.0, 0.0), turn, ns)
    tf.publish(TFMessage(transforms=[edge]))


def redescribe():
    for line in sys.stdin:
        text = json.loads(line)
        if settings["by"] == "parameter":
            node.set_parameters([Parameter("robot_description", value=text)])
        else:
            describe.publish(String(data=text))


threading.Thread(target=redescribe, daemon=True).start()
node.create_timer(0.01, move)
spin(node)
