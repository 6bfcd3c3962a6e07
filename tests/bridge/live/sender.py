"""Independent ROS process that sends a tracker's poses and a robot's joints, with plain rclpy.

    sender.py FRAMES.json tf|tracked [again] [best_effort]

Waits for a subscriber, then sends the frames at the rate of their stamps, which are shifted to the
present. ``again`` repeats the frames; ``best_effort`` uses the QoS of sensor data, like most
drivers. Prints ``shift NANOSECONDS`` (present minus recorded time) before the first frame and
``sent`` after the last, and runs until standard input ends. It does not import the project.
"""

import json
import sys
import threading
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import TrackedTransform
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage


def fill(message, edge, ns):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
    message.header.frame_id, message.child_frame_id = edge["parent"], edge["child"]
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z = edge["translation_m"]
    turn.x, turn.y, turn.z, turn.w = edge["quaternion"]
    return message


def main() -> None:
    frames = json.loads(Path(sys.argv[1]).read_text())
    kind = sys.argv[2]
    again = "again" in sys.argv[3:]
    qos = qos_profile_sensor_data if "best_effort" in sys.argv[3:] else QoSProfile(depth=100)
    rclpy.init()
    node = rclpy.create_node("sender")
    matched = threading.Event()
    topic, message_type = {
        "tf": ("/tf", TFMessage),
        "tracked": ("/tracked_transforms", TrackedTransform),
    }[kind]
    poses = node.create_publisher(
        message_type,
        topic,
        qos,
        event_callbacks=PublisherEventCallbacks(matched=lambda _: matched.set()),
    )
    joints = node.create_publisher(JointState, "/joint_states", qos)
    while not matched.is_set():
        rclpy.spin_once(node)
    shift_ns = time.time_ns() - frames[0]["ns"]
    print(f"shift {shift_ns}", flush=True)
    while True:
        for frame in frames:
            ns = frame["ns"] + shift_ns
            time.sleep(max(0, ns - time.time_ns()) / 1e9)
            for sample in frame["joints"]:
                message = JointState(name=sample["names"], position=sample["positions"])
                sec, nanosec = divmod(sample["ns"] + shift_ns, 10**9)
                message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
                joints.publish(message)
            edges = frame["edges"]
            if kind == "tf":
                good = [edge for edge in edges if edge["status"] == 0]
                poses.publish(TFMessage(transforms=[fill(TransformStamped(), e, ns) for e in good]))
            else:
                for edge in edges:
                    poses.publish(fill(TrackedTransform(status=edge["status"]), edge, ns))
        if not again:
            break
        shift_ns += frames[-1]["ns"] - frames[0]["ns"] + 20_000_000
    print("sent", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
