"""Types and topics of recorded ROS messages, by rosbags without ROS, and their bytes.

Tracker and joint samples of a recording become the same bytes as those that rosbags writes of
message objects, which is slow for thousands of messages that differ in stamps and numbers only. The
layout is CDR in little-endian order: each field is aligned to its size, counted from the end of the
encapsulation's four bytes. Samples are in mm, messages in m. A sample that is not OK carries NaN,
so that a program that ignores its status cannot navigate by it.
"""

import math
import struct
from collections.abc import Iterable, Sequence
from functools import cache, lru_cache
from typing import Any, Self

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.case.frame_streams import JointSample
from app.case.messages.message_values import MM_PER_M
from app.geometry import (
    NS_PER_S,
    InputError,
    Stamp,
    TrackedTransform,
    Transform,
    quaternion_of_rotation,
)

# A general serialiser converts a message field by field; a recording has thousands of messages
# whose names are the same.

_ENCAPSULATION = b"\0\1\0\0"
_STAMP = struct.Struct("<iI")
_SEC_LIMIT = 2**31

Block = tuple[int, Sequence[float]]
"""A stamp in ns, and the numbers that follow it."""


def stamp_parts(ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a ROS time; raises `InputError` for one that does not fit."""
    sec, nanosec = divmod(ns, NS_PER_S)
    if not -_SEC_LIMIT <= sec < _SEC_LIMIT:
        raise InputError(f"stamp is {ns} ns; expected a ROS time, within 2^31 s of 0")
    return sec, nanosec


class CdrTemplate:
    """A message that is built field by field, with places for stamps and 64-bit numbers."""

    def __init__(self) -> None:
        self._raw = bytearray(_ENCAPSULATION)
        self._stamps: list[int] = []
        self._numbers: list[tuple[struct.Struct, int]] = []

    def stamp(self) -> Self:
        """Add a ``builtin_interfaces/Time``."""
        self._align(4)
        self._stamps.append(len(self._raw))
        self._raw += bytes(_STAMP.size)
        return self

    def text(self, text: str) -> Self:
        """Add a string."""
        data = text.encode() + b"\0"
        self.count(len(data))
        self._raw += data
        return self

    def count(self, number: int) -> Self:
        """Add an unsigned number of 32 bits, such as the length of a sequence."""
        self._align(4)
        self._raw += struct.pack("<I", number)
        return self

    def byte(self, number: int) -> Self:
        """Add an unsigned number of 8 bits."""
        self._raw.append(number)
        return self

    def numbers(self, count: int) -> Self:
        """Add ``count`` floating-point numbers."""
        if count:
            self._align(8)
        self._numbers.append((struct.Struct(f"<{count}d"), len(self._raw)))
        self._raw += bytes(8 * count)
        return self

    def serialized(self, blocks: Iterable[Block]) -> bytes:
        """The message with these stamps and numbers, one block for each place of both."""
        raw = self._raw
        for (ns, values), at, (layout, begin) in zip(
            blocks, self._stamps, self._numbers, strict=True
        ):
            _STAMP.pack_into(raw, at, *stamp_parts(ns))
            layout.pack_into(raw, begin, *values)
        return bytes(raw)

    def _align(self, size: int) -> None:
        self._raw += bytes((len(_ENCAPSULATION) - len(self._raw)) % size)


TRACKED_TRANSFORMS_TOPIC = "/tracked_transforms"
TF_TOPIC = "/tf"
JOINT_STATES_TOPIC = "/joint_states"
UNFILTERED_TIME_TOPIC = "/tracked_transforms/unfiltered_time"
"""Second clock of an IGSIO recording: header.stamp is the frame's stamp, time_ref the other."""

TRACKED_TRANSFORM = "marginguard_msgs/msg/TrackedTransform"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
JOINT_STATE = "sensor_msgs/msg/JointState"
TIME_REFERENCE = "sensor_msgs/msg/TimeReference"
BOOL = "std_msgs/msg/Bool"
RANGE = "sensor_msgs/msg/Range"

TRACKED_TRANSFORM_DEFINITION = """\
uint8 OK=0
uint8 INVALID=1
uint8 MISSING=2
uint8 OUT_OF_VIEW=3
uint8 OUT_OF_VOLUME=4
uint8 REQUEST_TIMEOUT=5
uint8 NOT_FINITE=6
uint8 NOT_RIGID=7
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
uint8 status
"""


@cache
def ros_types() -> Typestore:
    """The message types of ROS 2 Jazzy and of this project; shared and never modified."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TRACKED_TRANSFORM_DEFINITION, TRACKED_TRANSFORM))
    return store


def time_reference_message(stamp: Stamp, unfiltered: Stamp) -> Any:
    """Build a ``sensor_msgs/TimeReference``: the time of the unsmoothed clock at ``stamp``."""
    types = ros_types().types
    header = types["std_msgs/msg/Header"](stamp=_time(stamp.ns), frame_id="")
    return types[TIME_REFERENCE](header=header, time_ref=_time(unfiltered.ns), source="unfiltered")


def _time(ns: int) -> Any:
    sec, nanosec = stamp_parts(ns)
    return ros_types().types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)


_KEPT = 256
"""Templates of each kind: a recording has a few frames and joints."""

_UNKNOWN = (math.nan,) * 7


def tracked_transform_bytes(sample: TrackedTransform) -> bytes:
    """A serialised ``marginguard_msgs/TrackedTransform``."""
    template = _tracked_template(sample.target, sample.source, int(sample.status))
    return template.serialized([(sample.stamp.ns, _pose_numbers(sample.transform))])


def tf_bytes(samples: Sequence[TrackedTransform]) -> bytes:
    """A serialised ``tf2_msgs/TFMessage`` of samples that are all OK."""
    template = _tf_template(tuple((sample.target, sample.source) for sample in samples))
    return template.serialized(
        [(sample.stamp.ns, _pose_numbers(sample.transform)) for sample in samples]
    )


def joint_state_bytes(sample: JointSample, robot_ns: int) -> bytes:
    """A serialised ``sensor_msgs/JointState``, stamped ``robot_ns`` on the robot's own clock."""
    template = _joint_template(tuple(sample.names))
    return template.serialized([(robot_ns, sample.positions)])


@lru_cache(maxsize=_KEPT)
def _tracked_template(target: str, source: str, status: int) -> CdrTemplate:
    return CdrTemplate().stamp().text(target).text(source).numbers(7).byte(status)


@lru_cache(maxsize=_KEPT)
def _tf_template(edges: tuple[tuple[str, str], ...]) -> CdrTemplate:
    template = CdrTemplate().count(len(edges))
    for target, source in edges:
        template.stamp().text(target).text(source).numbers(7)
    return template


@lru_cache(maxsize=_KEPT)
def _joint_template(names: tuple[str, ...]) -> CdrTemplate:
    template = CdrTemplate().stamp().text("").count(len(names))
    for name in names:
        template.text(name)
    # Positions; velocity and effort are empty.
    return template.count(len(names)).numbers(len(names)).count(0).count(0)


def _pose_numbers(transform: Transform | None) -> Sequence[float]:
    """Translation in m and quaternion xyzw; NaN without a pose."""
    if transform is None:
        return _UNKNOWN
    position_m = (transform.translation_mm / MM_PER_M).tolist()
    return [*position_m, *quaternion_of_rotation(transform.rotation)]
