"""Values of ROS messages, samples and images made of them, and definitions of their types."""

import math
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.case.frame_streams import JointSample
from app.geometry import (
    MAX_IMAGE_SIDE,
    NS_PER_S,
    ImageSample,
    ImageStatus,
    InputError,
    Pixels,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    rotation_of_quaternion,
)

MM_PER_M = 1000.0


class PoseValues(NamedTuple):
    """A stamped transform in the numbers of its message: metres, quaternion as x, y, z, w."""

    target: str
    source: str
    ns: int
    translation_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    status: int = int(TrackingStatus.OK)

    @property
    def edge(self) -> tuple[str, str]:
        """Target (parent) and source (child) frame."""
        return self.target, self.source

    def sample(self) -> TrackedTransform:
        """The sample in mm. A pose that is not finite or not rigid is lost; its status says so.

        An unknown status counts as INVALID. Raises `FrameError` for names that cannot be frames.
        """
        target, source, ns, (x, y, z), quaternion, status = self
        stamp = Stamp(ns)
        if status != TrackingStatus.OK:
            known = _STATUSES.get(status, TrackingStatus.INVALID)
            return TrackedTransform.lost(target, source, stamp, known)
        translation_mm = (MM_PER_M * x, MM_PER_M * y, MM_PER_M * z)
        if not all(map(math.isfinite, translation_mm + quaternion)):
            return TrackedTransform.lost(target, source, stamp, TrackingStatus.NOT_FINITE)
        try:
            rotation = rotation_of_quaternion(*quaternion)
        except TransformError:
            return TrackedTransform.lost(target, source, stamp, TrackingStatus.NOT_RIGID)
        transform = Transform.unchecked(target, source, rotation, np.array(translation_mm))
        return TrackedTransform.valid(transform, stamp)


_STATUSES = {int(status): status for status in TrackingStatus}


class JointValues(NamedTuple):
    """Joint positions as in their message, stamped on the robot's clock."""

    names: tuple[str, ...]
    positions: tuple[float, ...]
    ns: int

    def sample(self, *, offset_ns: int) -> JointSample:
        """The sample with its stamp moved to the tracker's clock: tracker = robot + offset.

        Raises `InputError` when names and positions differ in number, a name is repeated or a
        position is not finite.
        """
        names, positions, ns = self
        stamp = Stamp(ns + offset_ns)
        if len(set(names)) == len(positions) == len(names) and all(map(math.isfinite, positions)):
            return JointSample.unchecked(names, positions, stamp)
        # The constructor reports a wrong number of positions and a repeated name.
        JointSample(names, positions, stamp)
        name, position = next(
            pair for pair in zip(names, positions, strict=True) if not math.isfinite(pair[1])
        )
        raise InputError(f"joint {name!r} is at {position}; expected a finite position")


class TimeValues(NamedTuple):
    """One time in ns, by the clock of the frame and by the unfiltered clock."""

    ns: int
    unfiltered_ns: int


class RangeValues(NamedTuple):
    """A distance in m at a time in ns."""

    stamp_ns: int
    range_m: float


def tracked_values(message: Any) -> PoseValues:
    """Values of a ``marginguard_msgs/TrackedTransform``."""
    return _pose(message)._replace(status=int(message.status))


def tf_values(message: Any) -> tuple[PoseValues, ...]:
    """Values of a ``tf2_msgs/TFMessage``; its transforms count as OK."""
    return tuple(_pose(stamped) for stamped in message.transforms)


def joint_values(message: Any) -> JointValues:
    """Values of a ``sensor_msgs/JointState``."""
    positions = tuple(float(position) for position in message.position)
    return JointValues(tuple(message.name), positions, _ns(message.header.stamp))


def time_values(message: Any) -> TimeValues:
    """Values of a ``sensor_msgs/TimeReference``."""
    return TimeValues(_ns(message.header.stamp), _ns(message.time_ref))


def bool_value(message: Any) -> bool:
    """Value of a ``std_msgs/Bool``."""
    return bool(message.data)


def range_values(message: Any) -> RangeValues:
    """Stamp and range of a ``sensor_msgs/Range``."""
    return RangeValues(_ns(message.header.stamp), float(message.range))


def frame_name(text: str) -> str:
    """The name of a frame without the leading '/' that tf had before ROS 2."""
    return text.removeprefix("/")


def _pose(message: Any) -> PoseValues:
    move, turn = message.transform.translation, message.transform.rotation
    return PoseValues(
        frame_name(message.header.frame_id),
        frame_name(message.child_frame_id),
        _ns(message.header.stamp),
        (move.x, move.y, move.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def _ns(time: Any) -> int:
    return int(time.sec) * NS_PER_S + int(time.nanosec)


IMAGE = "sensor_msgs/msg/Image"
ENCODINGS = {"mono8": ("u1", 1), "mono16": ("u2", 1), "rgb8": ("u1", 3)}
"""Encoding: type of a value, values of a pixel. Others are not images of an ultrasound device."""

MAX_BYTES = (1 << 25) + 4096
"""32 MiB of pixels and the fields before them."""

_ENCAPSULATION = 4
_BYTE_ORDERS = {b"\0\0": ">", b"\0\1": "<"}
_MAX_TEXT = 256


def read_image_message(data: bytes, number: int) -> ImageSample:
    """Return the image of a message as image ``number``, in the orientation in which it was sent.

    Raises `InputError` for bytes that are not such a message, an encoding that is not one of
    `ENCODINGS`, sizes that do not match the data, and a stamp of 0, which means that none is known.
    """
    if len(data) > MAX_BYTES:
        raise InputError(f"image has {len(data)} bytes; expected {MAX_BYTES} or fewer")
    try:
        return _image(data, number)
    except struct.error as error:
        raise InputError(f"image message of {len(data)} bytes is cut: {error}") from error


def _image(data: bytes, number: int) -> ImageSample:
    order = _BYTE_ORDERS.get(data[:2])
    if order is None:
        raise InputError(f"image message begins with {data[:2].hex()!r}; expected 0000 or 0001")
    body = memoryview(data)[_ENCAPSULATION:]
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", body, 0)
    _, at = _text(body, 8, order)
    at = _aligned(at)
    rows, columns = struct.unpack_from(f"{order}2I", body, at)
    encoding, at = _text(body, at + 8, order)
    big_endian = struct.unpack_from("B", body, at)[0]
    at = _aligned(at + 1)
    row_bytes, size = struct.unpack_from(f"{order}2I", body, at)
    content = body[at + 8 :]
    if seconds < 0 or nanoseconds >= NS_PER_S or not (seconds or nanoseconds):
        raise InputError(f"image has the stamp {seconds} s {nanoseconds} ns; expected a time")
    if encoding not in ENCODINGS:
        raise InputError(
            f"encoding of the image is {encoding[:40]!r}; expected {', '.join(ENCODINGS)}"
        )
    if not (1 <= rows <= MAX_IMAGE_SIDE and 1 <= columns <= MAX_IMAGE_SIDE):
        raise InputError(
            f"image is {columns} x {rows}; expected 1 to {MAX_IMAGE_SIDE} on each side"
        )
    sample, channels = ENCODINGS[encoding]
    needed = columns * channels * np.dtype(sample).itemsize
    if row_bytes < needed or size != rows * row_bytes or not 0 <= len(content) - size <= 3:
        raise InputError(
            f"image of {columns} x {rows} {encoding} has rows of {row_bytes} bytes and "
            f"{len(content)} bytes of pixels; expected {needed} or more, and {rows} times that"
        )
    values = np.frombuffer(content[:size], np.uint8).reshape(rows, row_bytes)[:, :needed]
    dtype = np.dtype(sample).newbyteorder(">" if big_endian else "<")
    pixels: Pixels = np.ascontiguousarray(values).view(dtype).reshape(rows, columns, channels)
    pixels = pixels[:, :, 0] if channels == 1 else pixels
    pixels = pixels.astype(dtype.newbyteorder("="))
    stamp = Stamp(seconds * NS_PER_S + nanoseconds)
    return ImageSample(number, stamp, ImageStatus.OK, pixels)


def _text(body: memoryview, at: int, order: str) -> tuple[str, int]:
    """The string at ``at``, and the place after it."""
    at = _aligned(at)
    (count,) = struct.unpack_from(f"{order}I", body, at)
    end = at + 4 + count
    if not 1 <= count <= _MAX_TEXT or end > len(body) or body[end - 1] != 0:
        raise InputError(
            f"image message has a text of {count} bytes; expected 1 to {_MAX_TEXT} with a "
            "terminating zero"
        )
    return bytes(body[at + 4 : end - 1]).decode("utf-8", "replace"), end


def _aligned(at: int) -> int:
    return -(-at // 4) * 4


_TYPE = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_FIELD = re.compile(r"(?:([a-z][a-z0-9_]*)/(?:msg/)?)?([A-Z][A-Za-z0-9]*)(?:\[[^]]*\])?\s")
_SEPARATOR = "=" * 80


def message_definition(message_type: str, prefixes: Sequence[Path]) -> str:
    """The ``ros2msg`` schema of ``message_type`` (``package/msg/Name``).

    ``prefixes``: installation folders of ROS packages, searched at ``share/PACKAGE/msg``. Raises
    `InputError` for a malformed type and for a definition that is in none of them.
    """
    texts: dict[str, str] = {}
    names = [message_type]
    for name in names:  # grows during the loop
        match = _TYPE.fullmatch(name)
        if match is None:
            raise InputError(f"message type is {name!r}; expected package/msg/Name")
        package = match[1]
        texts[name] = _definition_text(package, match[2], prefixes)
        for line in texts[name].splitlines():
            field = _FIELD.match(line)
            part = field and f"{field[1] or package}/msg/{field[2]}"
            if part and part not in names:
                names.append(part)
    first, *others = names
    parts = [f"MSG: {name.replace('/msg/', '/')}\n{texts[name]}" for name in others]
    return f"\n{_SEPARATOR}\n".join([texts[first], *parts])


def _definition_text(package: str, name: str, prefixes: Sequence[Path]) -> str:
    for prefix in prefixes:
        path = prefix / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8").rstrip()
    searched = ", ".join(str(prefix) for prefix in prefixes) or "nowhere"
    raise InputError(
        f"the definition of {package}/msg/{name} was not found; searched in {searched}"
    )
