"""Independent ROS process that sends what another process sends too, with plain rclpy.

    rival.py FRAMES.json WHAT [NODE_NAME]

Waits for a subscriber and prints ``ready``. Each ``go`` on standard input starts sending, which
prints ``begun NANOSECONDS`` (system time) before the first message. With ``end`` it leaves the
graph and exits. It does not import the project.

======================  ========================================================
``tf``, ``tracked``     the pose of the cautery, 100 mm off, at 60 Hz
``joints``              the robot's joints 0.5 rad off, at 60 Hz
``gripper``             the joint of another device on the robot's topic, at 60 Hz
``constraint``          constraints that allow everything, at 60 Hz
``static``              the robot's base turned, latched on /tf_static, once
======================  ========================================================
"""

import json
import sys
import threading
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import FixtureConstraint, TrackedTransform
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import edge_message, spin, stamped

PERIOD_S = 1 / 60
TOPICS = {
    "tracked": ("/tracked_transforms", TrackedTransform),
    "joints": ("/joint_states", JointState),
    "gripper": ("/joint_states", JointState),
    "constraint": ("/marginguard/constraint", FixtureConstraint),
    "static": ("/tf_static", TFMessage),
}


def main():
    frames = json.loads(Path(sys.argv[1]).read_text())
    what = sys.argv[2]
    topic, message_type = TOPICS.get(what, ("/tf", TFMessage))
    latched = topic == "/tf_static"
    edge = next(each for each in frames[0]["edges"] if each["child"] == "cautery")
    joints = next(joints for frame in frames for joints in frame["joints"])

    parent, child = ("reference", "robot_base") if latched else (edge["parent"], "cautery")
    place_m = [edge["translation_m"][0] + 0.1, *edge["translation_m"][1:]]

    def pose(message):
        return edge_message(message, parent, child, place_m, edge["quaternion"], time.time_ns())

    def message():
        if message_type is JointState:
            names, positions = joints["names"], [each + 0.5 for each in joints["positions"]]
            if what == "gripper":
                names, positions = ["finger"], [0.01]
            return stamped(JointState(name=names, position=positions), time.time_ns())
        if message_type is FixtureConstraint:
            return FixtureConstraint(state=FixtureConstraint.POSITIVE)
        if message_type is TrackedTransform:
            return pose(TrackedTransform())
        return TFMessage(transforms=[pose(TransformStamped())])

    rclpy.init()
    node = rclpy.create_node(sys.argv[3] if len(sys.argv) > 3 else "rival")
    matched, sending, leaving = threading.Event(), threading.Event(), threading.Lock()
    qos = QoSProfile(depth=100)
    if latched:
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = node.create_publisher(
        message_type,
        topic,
        qos,
        event_callbacks=PublisherEventCallbacks(matched=lambda _: matched.set()),
    )

    spinner = threading.Thread(target=spin, args=(node,), daemon=True)
    spinner.start()
    while not matched.is_set():
        time.sleep(0.005)
    print("ready", flush=True)

    def send():
        while True:
            sending.wait()
            with leaving:
                publisher.publish(message())
            if latched:
                return
            time.sleep(PERIOD_S)

    threading.Thread(target=send, daemon=True).start()
    for line in sys.stdin:
        if line.strip() == "go":
            print(f"begun {time.time_ns()}", flush=True)
            sending.set()
        elif line.strip() == "end":
            leaving.acquire()  # nothing is sent any more
            rclpy.shutdown()
            spinner.join()
            node.destroy_node()
            return


if __name__ == "__main__":
    main()
