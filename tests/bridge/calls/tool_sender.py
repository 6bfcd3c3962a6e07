"""Process that publishes a tool rotating about its fixed tip on tf at 200 Hz with plain rclpy.

    tool_sender.py MOTION

``pivot``: about the tip in all directions; ``spin``: about the shaft; ``still``: at rest, with the
tip on ``/tf_static``. The tip is at (5, 12.6, 103.3) mm of the frame ``stylus``, the shaft is its
z-axis through the tip, the fixed point is at (100, -50, 20) mm of ``reference``. Prints ``ready``;
ends when it is killed.
"""

import random
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from tests.bridge.peers import edge_message, spin

TIP = np.array([5.0, 12.6, 103.3])
FIXED = np.array([100.0, -50.0, 20.0])


def rotation_about(axis, angle):
    """Quaternion (x, y, z, w) and matrix of a rotation about ``axis``."""
    x, y, z = axis = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return (*(np.sin(angle / 2) * axis), np.cos(angle / 2)), matrix


def message(parent, child, ns, quaternion, translation_mm):
    translation_m = [float(value) / 1000.0 for value in translation_mm]
    edge = edge_message(TransformStamped(), parent, child, translation_m, quaternion, ns)
    return TFMessage(transforms=[edge])


def main(motion):
    rclpy.init()
    node = rclpy.create_node("tool_sender")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = node.create_publisher(TFMessage, "/tf_static", latched)
    if motion != "pivot":
        static.publish(message("stylus", "stylus_tip", time.time_ns(), (0, 0, 0, 1), TIP))
    chance = random.Random(7)

    def send():
        if motion == "pivot":
            around = chance.uniform(0, 2 * np.pi)
            quaternion, matrix = rotation_about(
                [np.cos(around), np.sin(around), 0.1], chance.uniform(0, 1)
            )
        elif motion == "spin":
            quaternion, matrix = rotation_about([0, 0, 1], chance.uniform(-1.5, 1.5))
        else:
            quaternion, matrix = rotation_about([0, 0, 1], 0.0)
        noise = [chance.gauss(0, 0.05) for _ in range(3)]
        position = FIXED - matrix @ TIP + noise
        publisher.publish(message("reference", "stylus", time.time_ns(), quaternion, position))

    node.create_timer(0.005, send)
    print("ready", flush=True)
    spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
