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

from tests.bridge.peers import edge_message, stamped


def filled(message, edge, ns):
    values = (edge[key] for key in ("parent", "child", "translation_m", "quaternion"))
    return edge_message(message, *values, ns)


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
                joints.publish(stamped(message, sample["ns"] + shift_ns))
            edges = frame["edges"]
            if kind == "tf":
                good = [edge for edge in edges if edge["status"] == 0]
                poses.publish(
                    TFMessage(transforms=[filled(TransformStamped(), e, ns) for e in good])
                )
            else:
                for edge in edges:
                    poses.publish(filled(TrackedTransform(status=edge["status"]), edge, ns))
        if not again:
            break
        shift_ns += frames[-1]["ns"] - frames[0]["ns"] + 20_000_000
    print("sent", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
