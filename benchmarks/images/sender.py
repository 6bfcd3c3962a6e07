"""Independent ROS process that sends tracked poses and images, with plain rclpy.

    python -m benchmarks.images.sender [--encoding mono8] [--stamped]

Sends until standard input ends. An image is stamped between two poses, and sent after the second.
Image ``n`` is `image_values` of ``n``; with ``--stamped`` its number is drawn into it. Prints
``begin``, the time in ns from which `image_stamp_ns` counts. It does not import ``app``.
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

from benchmarks.harness.peer import emit, input_ended, set_time
from benchmarks.images import session
from benchmarks.view.stamps import stamp

_DIFFERENT = 16  # images sent in turn; their speckle does not compress, as that of a real probe


def image_values(number: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(number % _DIFFERENT)
    return rng.integers(0, 256, (session.ROWS, session.COLUMNS), dtype=np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--encoding", default="mono8")
    parser.add_argument("--stamped", action="store_true")
    options = parser.parse_args()
    ended = input_ended()
    rclpy.init()
    node = rclpy.create_node("images_sender")
    poses = node.create_publisher(TrackedTransform, "/tracked_transforms", 100)
    images = node.create_publisher(Image, session.TOPIC, qos_profile_sensor_data)
    contents = [image_values(n) for n in range(_DIFFERENT)]
    noise = np.random.default_rng(1)
    begin_ns, tick = time.time_ns(), 0
    emit("begin", ns=begin_ns)
    while not ended.is_set():
        due_ns = begin_ns + tick * session.POSE_NS
        time.sleep(max(0, due_ns - time.time_ns()) / 1e9)
        for name, place_mm in session.POSES_MM.items():
            message = TrackedTransform(status=0)
            set_time(message.header.stamp, due_ns)
            message.header.frame_id, message.child_frame_id = "tracker", name
            move = message.transform.translation
            # A pose that repeats exactly counts as frozen.
            move.x, move.y, move.z = ((v + noise.normal(0.0, 0.02)) / 1000.0 for v in place_mm)
            poses.publish(message)
        number, rest = divmod(tick, session.POSES_OF_IMAGE)
        if rest == 0:
            pixels = contents[number % _DIFFERENT]
            if options.stamped:
                stamp(pixels, number)
            rows, columns = pixels.shape
            image = Image(height=rows, width=columns, encoding=options.encoding, step=columns)
            set_time(image.header.stamp, session.image_stamp_ns(begin_ns, number))
            image.header.frame_id = "image"
            image.data = array("B", pixels.tobytes())
            images.publish(image)
        tick += 1
    rclpy.shutdown()


if __name__ == "__main__":
    main()
