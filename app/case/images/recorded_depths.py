"""The imaging depths that an operator chose while a case was recorded, on a topic of its bag.

Each is a ``sensor_msgs/Range``: ``range`` is the depth in m, ``header.stamp`` the time on the clock
of the tracker after which it holds.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.case.messages.decoder import values_reader
from app.case.messages.ros_messages import RANGE
from app.case.readers.rosbag2.bag import mcap_parts
from app.case.readers.rosbag2.mcap_file import read_placed_messages
from app.files.bounded_io import is_folder

IMAGE_DEPTH_TOPIC = "/marginguard/image_depth"


@dataclass(frozen=True, slots=True)
class RecordedDepth:
    """``depth_mm`` holds for images that are stamped after ``from_ns``."""

    depth_mm: float
    from_ns: int


def recorded_depths(path: Path) -> Iterator[RecordedDepth]:
    """Yield the depths in the MCAP file or the folder ``path``, in the order of their recording.

    Raises `InputError` for a message that is no depth.
    """
    read = values_reader(RANGE)
    for part in mcap_parts(path) if is_folder(path) else [path]:
        for _, data in read_placed_messages(part, IMAGE_DEPTH_TOPIC):
            values = read(data)
            yield RecordedDepth(1000.0 * values.range_m, values.stamp_ns)
