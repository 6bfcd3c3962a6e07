"""Read and write ``tf2_msgs/TFMessage`` as CDR bytes, without rclpy's message objects.

Deserialising 26 transforms takes over a millisecond with rclpy and a small part of that here.
"""

import struct
from collections.abc import Iterable
from typing import NamedTuple

from app.bridge.messages import MM_PER_M
from app.bridge.tf.errors import TfInvalidError
from app.bridge.tf.pose import Pose
from app.case.messages.decoder import tf_reader
from app.geometry import NS_PER_S

_COUNT = struct.Struct("<I")
_HEAD = struct.Struct("<iII")
_POSE = struct.Struct("<7d")


class TfSample(NamedTuple):
    """``parent_from_child`` at ``stamp_ns``; the pose is in mm and not validated."""

    parent: str
    child: str
    stamp_ns: int
    pose: Pose


class TfMessageReader:
    """Reads serialised messages of one topic. Not thread-safe."""

    def __init__(self) -> None:
        self._read = tf_reader()

    def __call__(self, message: bytes) -> list[TfSample]:
        """Deserialise a message, converting m to mm; raises `TfInvalidError` for invalid bytes."""
        try:
            poses = self._read(message)
        except ValueError as error:
            raise TfInvalidError(
                f"a tf message of {len(message)} bytes is invalid: {error}"
            ) from error
        return [
            TfSample(parent, child, ns, (MM_PER_M * x, MM_PER_M * y, MM_PER_M * z, *quaternion))
            for parent, child, ns, (x, y, z), quaternion, _ in poses
        ]


def write_tf_message(samples: Iterable[TfSample]) -> bytes:
    """Serialise ``samples`` to a message, converting mm to m, for a raw publish."""
    body = bytearray(4)
    count = 0
    for parent, child, stamp_ns, pose in samples:
        count += 1
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        name = parent.encode() + b"\0"
        body += bytes(-len(body) % 4) + _HEAD.pack(seconds, nanoseconds, len(name)) + name
        name = child.encode() + b"\0"
        body += bytes(-len(body) % 4) + _COUNT.pack(len(name)) + name
        x, y, z, p, q, r, s = pose
        x, y, z = x / MM_PER_M, y / MM_PER_M, z / MM_PER_M
        body += bytes(-len(body) % 8) + _POSE.pack(x, y, z, p, q, r, s)
    _COUNT.pack_into(body, 0, count)
    return b"\x00\x01\x00\x00" + bytes(body)
