"""Independent ROS process: a controller that sends one velocity, and a judge of what it reads.

Reads a line of JSON for each round: ``{"velocity": [...], "names": [...]}`` for ``servo_jv``, or a
``topic`` with its values; with ``node`` as the topic, another node of that name sends from then on.
Sends it with the present stamp, and prints the newest message of each topic as a line of JSON.
Leaves the graph at the end of the input. It does not import the project.
"""

import json
import sys
import threading

import rclpy
from crtk_msgs.msg import OperatingState, StringStamped
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from marginguard_msgs.msg import TrackedTransform
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import as_plain, spin


def joints(command):
    return JointState(
        name=command["names"],
        velocity=command.get("velocity", []),
        position=command.get("position", []),
    )


def pose(command):
    message = PoseStamped()
    message.header.frame_id = command["frame"]
    point, turn = message.pose.position, message.pose.orientation
    point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w = command["values"]
    return message


def twist(command):
    message = TwistStamped()
    message.header.frame_id = command["frame"]
    linear = message.twist.linear
    linear.x, linear.y, linear.z = command["values"]
    return message


def wrench(command):
    message = WrenchStamped()
    message.header.frame_id = command["frame"]
    force = message.wrench.force
    force.x, force.y, force.z = command["values"]
    return message


MESSAGES = {
    "servo_jv": joints,
    "servo_jp": joints,
    "servo_jf": joints,
    "servo_cp": pose,
    "servo_cv": twist,
    "servo_cf": wrench,
    "body/servo_cf": wrench,
    "move_jp": joints,
    "state_command": lambda command: StringStamped(string=command["values"]),
}


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("arm_peer")
    newest = {}
    topics = {
        "measured_js": ("/arm/measured_js", JointState),
        "setpoint_js": ("/arm/setpoint_js", JointState),
        "measured_cp": ("/arm/measured_cp", PoseStamped),
        "measured_cv": ("/arm/measured_cv", TwistStamped),
        "setpoint_cp": ("/arm/setpoint_cp", PoseStamped),
        "base_cf": ("/arm/measured_cf", WrenchStamped),
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
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(
        OperatingState,
        "/arm/operating_state",
        lambda m: newest.__setitem__("operating_state", m),
        latched,
    )
    publishers, sender = {}, node
    if "idle" not in sys.argv:
        publishers["servo_jv"] = node.create_publisher(JointState, "/arm/servo_jv", 1)
    spinning = threading.Thread(target=spin, args=(node,), daemon=True)
    spinning.start()
    print("ready", flush=True)
    for line in sys.stdin:
        command = json.loads(line)
        if command.get("topic") == "node":
            for publisher in publishers.values():
                sender.destroy_publisher(publisher)
            publishers.clear()
            sender = rclpy.create_node(command["values"])
        elif command:
            topic = command.get("topic", "servo_jv")
            message = MESSAGES[topic](command)
            message.header.stamp = node.get_clock().now().to_msg()
            message.header.stamp.sec += command.get("ahead_s", 0)
            if topic not in publishers:
                publishers[topic] = sender.create_publisher(type(message), f"/arm/{topic}", 1)
            publishers[topic].publish(message)
        print(json.dumps({key: as_plain(value) for key, value in dict(newest).items()}), flush=True)
    rclpy.shutdown()
    spinning.join()
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main())
