"""Independent ROS process: a controller that sends one velocity, and a judge of what it reads.

Reads a line of JSON for each round: ``{"velocity": [...], "names": [...]}``, sends it with the
present stamp, and prints the newest message of each topic as a line of JSON. It does not import the
project.
"""

import contextlib
import json
import sys
import threading

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from marginguard_msgs.msg import TrackedTransform
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage


def plain(message):
    fields = message.get_fields_and_field_types()
    return {name: value_of(getattr(message, name)) for name in fields}


def value_of(value):
    if hasattr(value, "get_fields_and_field_types"):
        return plain(value)
    if isinstance(value, bytes):
        return value[0]
    if isinstance(value, str | int | float | bool):
        return value
    return [value_of(each) for each in value]


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("arm_peer")
    newest = {}
    topics = {
        "measured_js": ("/arm/measured_js", JointState),
        "setpoint_js": ("/arm/setpoint_js", JointState),
        "measured_cp": ("/arm/measured_cp", PoseStamped),
        "measured_cv": ("/arm/measured_cv", TwistStamped),
        "measured_cf": ("/arm/body/measured_cf", WrenchStamped),
        "tracked": ("/tracked_transforms", TrackedTransform),
        "diagnostics": ("/diagnostics", DiagnosticArray),
    }
    for key, (name, kind) in topics.items():
        node.create_subscription(kind, name, lambda m, key=key: newest.__setitem__(key, m), 100)

    def take_tf(message):
        for edge in message.transforms:
            newest[edge.child_frame_id] = edge

    node.create_subscription(TFMessage, "/tf", take_tf, 100)
    publisher = node.create_publisher(JointState, "/arm/servo_jv", 1)
    threading.Thread(target=spin, args=(node,), daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        if command:
            message = JointState(name=command["names"], velocity=command["velocity"])
            message.header.stamp = node.get_clock().now().to_msg()
            message.header.stamp.sec += command.get("ahead_s", 0)
            publisher.publish(message)
        print(json.dumps({key: plain(value) for key, value in dict(newest).items()}), flush=True)
    return 0


def spin(node):
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    sys.exit(main())
