"""``tf2_msgs/TFMessage`` straight from its CDR bytes, without a Python object a field.

Twenty-six transforms cost over a millisecond through rclpy's message objects and a small part of
that here. The layout
is plain CDR (OMG, "Common Data Representation"), as every ROS 2 middleware sends it: after four
bytes that name the byte order, numbers are aligned to their size and strings carry their length,
the terminating zero included.
"""

import struct
from collections.abc import Iterable
from typing import NamedTuple

from app.bridge.messages import MM_PER_M
from app.bridge.tf.errors import TfInvalidError
from app.bridge.tf.pose import Pose
from app.geometry import NS_PER_S

_BYTE_ORDER = {b"\x00\x00": ">", b"\x00\x01": "<"}
_LONGEST_NAME = 1_024
_SMALLEST = 4 + 4 + 4 + 1 + 4 + 1 + 7 * 8
"""Bytes that a transform with two empty names takes, less its padding."""


class TfSample(NamedTuple):
    """``parent_from_child`` at ``stamp_ns``; the pose in mm, as the sender gave it, unchecked."""

    parent: str
    child: str
    stamp_ns: int
    pose: Pose


class _Formats(NamedTuple):
    length: struct.Struct
    head: struct.Struct
    pose: struct.Struct


_FORMATS = {
    order: _Formats(*(struct.Struct(order + code) for code in ("I", "iII", "7d"))) for order in "<>"
}
_LITTLE = _FORMATS["<"]


def read_tf_message(message: bytes) -> list[TfSample]:
    """The transforms of a serialised message, metres made mm; `TfInvalidError` for other bytes."""
    order = _BYTE_ORDER.get(message[:2])
    if order is None:
        raise TfInvalidError(
            f"a tf message begins with {message[:2].hex() or 'nothing'}: 0000 or 0001 (CDR) wanted"
        )
    body = memoryview(message)[4:]
    formats = _FORMATS[order]
    try:
        (count,) = formats.length.unpack_from(body, 0)
        if count * _SMALLEST > len(body):
            raise TfInvalidError(f"a tf message of {len(body)} bytes cannot hold {count} samples")
        samples, place = [], 4
        for _ in range(count):
            sample, place = _read_sample(body, place, formats)
            samples.append(sample)
    except (struct.error, UnicodeDecodeError) as error:
        raise TfInvalidError(f"a tf message of {len(body)} bytes is damaged: {error}") from error
    return samples


def write_tf_message(samples: Iterable[TfSample]) -> bytes:
    """The serialised message of ``samples``, mm made metres, to be published as it is."""
    body = bytearray(4)
    count = 0
    for parent, child, stamp_ns, pose in samples:
        count += 1
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        name = parent.encode() + b"\0"
        body += bytes(-len(body) % 4) + _LITTLE.head.pack(seconds, nanoseconds, len(name)) + name
        name = child.encode() + b"\0"
        body += bytes(-len(body) % 4) + _LITTLE.length.pack(len(name)) + name
        x, y, z, p, q, r, s = pose
        x, y, z = x / MM_PER_M, y / MM_PER_M, z / MM_PER_M
        body += bytes(-len(body) % 8) + _LITTLE.pose.pack(x, y, z, p, q, r, s)
    _LITTLE.length.pack_into(body, 0, count)
    return b"\x00\x01\x00\x00" + bytes(body)


def _read_sample(body: memoryview, place: int, formats: _Formats) -> tuple[TfSample, int]:
    place = -(-place // 4) * 4
    seconds, nanoseconds, length = formats.head.unpack_from(body, place)
    parent, place = _name(body, place + 12, length)
    place = -(-place // 4) * 4
    (length,) = formats.length.unpack_from(body, place)
    child, place = _name(body, place + 4, length)
    place = -(-place // 8) * 8
    x, y, z, p, q, r, s = formats.pose.unpack_from(body, place)
    pose = (MM_PER_M * x, MM_PER_M * y, MM_PER_M * z, p, q, r, s)
    return TfSample(parent, child, seconds * NS_PER_S + nanoseconds, pose), place + 56


def _name(body: memoryview, place: int, length: int) -> tuple[str, int]:
    if not 1 <= length <= _LONGEST_NAME:
        raise TfInvalidError(
            f"a tf message holds a frame name of {length} bytes: 1 to {_LONGEST_NAME} allowed"
        )
    end = place + length
    if end > len(body):
        raise TfInvalidError(f"a tf message of {len(body)} bytes ends within a name")
    return str(body[place : end - 1], "utf-8"), end
