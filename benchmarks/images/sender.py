"""Independent ROS process that sends tracked poses and images, with plain rclpy.

    python -m benchmarks.images.sender [--encoding mono8]

Sends until standard input ends. An image is stamped between two poses, and sent after the second.
Image ``n`` is `image_values` of ``n``. It does not import ``app``.
"""

import argparse
import time
from array import array

import numpy as np
import rclpy
from marginguard_msgs.msg import TrackedTransform
from numpy.typing import NDArray
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from benchmarks.harness.peer import input_ended, set_time
from benchmarks.images.session import COLUMNS, POSES_MM, ROWS, TOPIC

IMAGES_HZ, POSES_HZ = 30, 60
_DIFFERENT = 16  # images sent in turn; their speckle does not compress, as that of a real probe


def image_values(number: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(number % _DIFFERENT)
    return rng.integers(0, 256, (ROWS, COLUMNS), dtype=np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--encoding", default="mono8")
    options = parser.parse_args()
    ended = input_ended()
    rclpy.init()
    node = rclpy.create_node("images_sender")
    poses = node.create_publisher(TrackedTransform, "/tracked_transforms", 100)
    images = node.create_publisher(Image, TOPIC, qos_profile_sensor_data)
    contents = [array("B", image_values(n).tobytes()) for n in range(_DIFFERENT)]
    period_ns = round(1e9 / POSES_HZ)
    each = POSES_HZ // IMAGES_HZ
    noise = np.random.default_rng(1)
    begin_ns, tick = time.time_ns(), 0
    while not ended.is_set():
        due_ns = begin_ns + tick * period_ns
        time.sleep(max(0, due_ns - time.time_ns()) / 1e9)
        for name, place_mm in POSES_MM.items():
            message = TrackedTransform(status=0)
            set_time(message.header.stamp, due_ns)
            message.header.frame_id, message.child_frame_id = "tracker", name
            move = message.transform.translation
            # A pose that repeats exactly counts as frozen.
            move.x, move.y, move.z = ((v + noise.normal(0.0, 0.02)) / 1000.0 for v in place_mm)
            poses.publish(message)
        if tick % each == 0:
            image = Image(height=ROWS, width=COLUMNS, encoding=options.encoding, step=COLUMNS)
            set_time(image.header.stamp, due_ns - period_ns // 3)
            image.header.frame_id = "image"
            image.data = contents[tick // each % _DIFFERENT]
            images.publish(image)
        tick += 1
    rclpy.shutdown()


if __name__ == "__main__":
    main()
