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

from tests.bridge.peers import spin

PERIOD_S = 1 / 60
TOPICS = {
    "tracked": ("/tracked_transforms", TrackedTransform),
    "joints": ("/joint_states", JointState),
    "gripper": ("/joint_states", JointState),
    "constraint": ("/marginguard/constraint", FixtureConstraint),
    "static": ("/tf_static", TFMessage),
}


def stamp(header):
    header.stamp.sec, header.stamp.nanosec = divmod(time.time_ns(), 10**9)


def main():
    frames = json.loads(Path(sys.argv[1]).read_text())
    what = sys.argv[2]
    topic, message_type = TOPICS.get(what, ("/tf", TFMessage))
    latched = topic == "/tf_static"
    edge = next(each for each in frames[0]["edges"] if each["child"] == "cautery")
    joints = next(joints for frame in frames for joints in frame["joints"])

    def pose(message):
        stamp(message.header)
        parent_and_child = ("reference", "robot_base") if latched else (edge["parent"], "cautery")
        message.header.frame_id, message.child_frame_id = parent_and_child
        move, turn = message.transform.translation, message.transform.rotation
        x, y, z = edge["translation_m"]
        move.x, move.y, move.z = x + 0.1, y, z
        turn.x, turn.y, turn.z, turn.w = edge["quaternion"]
        return message

    def message():
        if message_type is JointState:
            found = JointState(
                name=joints["names"], position=[each + 0.5 for each in joints["positions"]]
            )
            if what == "gripper":
                found = JointState(name=["finger"], position=[0.01])
            stamp(found.header)
            return found
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
