"""Poses and joints straight from the bytes of their messages, where these are laid out as ours.

A minute of recording holds some ten thousand messages, and rosbags makes an object of every field
of each. Here the few numbers that are wanted are taken from where the layout has them. Bytes that
are not exactly such a message (another byte order, a name without its closing zero, a wrong length)
give None: they go the way through rosbags, which knows whether they are one at all.

Layout: plain CDR (OMG DDS-XTypes 1.3, section 7.4.1): 4 bytes of encapsulation, then every value
at a multiple of its own size, counted from behind them.
"""

import struct
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict

from app.case.message_values import JointValues, PoseValues
from app.case.ros_messages import JOINT_STATE, TF_MESSAGE, TRACKED_TRANSFORM
from app.geometry import NS_PER_S

_Names = tuple[str, str]
_Move = tuple[float, float, float]
_Turn = tuple[float, float, float, float]
Values = PoseValues | tuple[PoseValues, ...] | JointValues
ReadBytes = Callable[[bytes], Values | None]

_LITTLE_ENDIAN = b"\0\1"
_ENCAPSULATION = 4
_COUNT = struct.Struct("<I")
_TIME = struct.Struct("<iI")
_TIME_AND_COUNT = struct.Struct("<iII")
_POSE = struct.Struct("<7d")
_PADDING = 3
"""So many bytes may follow a message, to a multiple of four."""


def bytes_reader(definitions: Typesdict, message_type: str) -> ReadBytes | None:
    """What reads messages of this type; None when it is not defined as we know it."""
    layout, make_reader = _READERS.get(message_type, ((), None))
    try:
        known = tuple(_fields(definitions, message_type)) == layout
    except (KeyError, RecursionError):
        known = False
    if make_reader is None or not known:
        return None
    read = make_reader()

    def read_data(data: bytes) -> Values | None:
        if data[:2] != _LITTLE_ENDIAN:
            return None
        body = data[_ENCAPSULATION:]
        try:
            values, end = read(body)
        except (struct.error, IndexError, ValueError):
            return None
        return values if end <= len(body) <= end + _PADDING else None

    return read_data


def _tracked(body: bytes) -> tuple[PoseValues, int]:
    names, ns, move, turn, end = _pose(body, 0)
    return PoseValues(*names, ns, move, turn, body[end]), end + 1


def _tf(body: bytes) -> tuple[tuple[PoseValues, ...], int]:
    count, at = _count(body, 0)
    poses = []
    for _ in range(count):
        names, ns, move, turn, at = _pose(body, at)
        poses.append(PoseValues(*names, ns, move, turn))
    return tuple(poses), at


def _pose(body: bytes, at: int) -> tuple[_Names, int, _Move, _Turn, int]:
    """What `TrackedTransform` and `TransformStamped` have in common, and where it ends."""
    at = (at + 3) & ~3
    sec, nanosec, count = _TIME_AND_COUNT.unpack_from(body, at)
    first = at + _TIME.size
    second = (first + _COUNT.size + count + 3) & ~3
    end = second + _COUNT.size + _COUNT.unpack_from(body, second)[0]
    at = (end + 7) & ~7
    x, y, z, qx, qy, qz, qw = _POSE.unpack_from(body, at)
    ns = sec * NS_PER_S + nanosec
    return _two_names(body[first:end]), ns, (x, y, z), (qx, qy, qz, qw), at + _POSE.size


@lru_cache(maxsize=1024)  # a recording has few frames, and names them over and over
def _two_names(text: bytes) -> _Names:
    target, at = _name(text, 0)
    return target, _name(text, at)[0]


class _JointReader:
    """A robot says the same names in every message: parsed once, they are compared as bytes."""

    def __init__(self) -> None:
        self._known = b""
        self._names: tuple[str, ...] = ()

    def __call__(self, body: bytes) -> tuple[JointValues, int]:
        sec, nanosec = _TIME.unpack_from(body, 0)
        _, at = _name(body, _TIME.size)
        at = (at + 3) & ~3
        if not (self._known and body.startswith(self._known, at)):
            self._names, end = _names(body, at)
            self._known = body[at:end]
        positions, at = _floats(body, at + len(self._known))
        at = _behind_floats(body, at)  # velocity
        at = _behind_floats(body, at)  # effort
        return JointValues(self._names, positions, sec * NS_PER_S + nanosec), at


def _names(body: bytes, at: int) -> tuple[tuple[str, ...], int]:
    count, at = _count(body, at)
    names = []
    for _ in range(count):
        name, at = _name(body, at)
        names.append(name)
    return tuple(names), at


def _name(body: bytes, at: int) -> tuple[str, int]:
    count, at = _count(body, at)
    end = at + count
    if count == 0 or body[end - 1] != 0:
        raise ValueError("no zero closes the name")
    return body[at : end - 1].decode(), end


def _floats(body: bytes, at: int) -> tuple[tuple[float, ...], int]:
    count, at = _count(body, at)
    if not count:
        return (), at
    at = (at + 7) & ~7
    return _doubles(count).unpack_from(body, at), at + 8 * count


def _behind_floats(body: bytes, at: int) -> int:
    count, at = _count(body, at)
    return ((at + 7) & ~7) + 8 * count if count else at


@lru_cache(maxsize=64)
def _doubles(count: int) -> struct.Struct:
    return struct.Struct(f"<{count}d")


def _count(body: bytes, at: int) -> tuple[int, int]:
    at = (at + 3) & ~3
    return _COUNT.unpack_from(body, at)[0], at + _COUNT.size


def _fields(definitions: Typesdict, message_type: str, prefix: str = "") -> Iterator[str]:
    """Name and type of every value that a message holds, in their order."""
    # Each is (kind, what of): a name, (basic type, bound) or, of a sequence, (such a field, bound).
    fields: list[tuple[str, Any]] = list(definitions[message_type][1])
    for name, field in fields:
        path, (kind, of) = f"{prefix}{name}", field
        if kind == Nodetype.SEQUENCE:
            path, (kind, of) = f"{path}[]", of[0]
        if kind == Nodetype.NAME:
            yield from _fields(definitions, str(of), f"{path}.")
        else:
            yield f"{path} {of[0]}"


_HEADER = ("header.stamp.sec int32", "header.stamp.nanosec uint32", "header.frame_id string")
_STAMPED = (
    *_HEADER,
    "child_frame_id string",
    *(f"transform.translation.{axis} float64" for axis in "xyz"),
    *(f"transform.rotation.{axis} float64" for axis in "xyzw"),
)
_ARRAYS = ("name[] string", "position[] float64", "velocity[] float64", "effort[] float64")
_Reader = Callable[[bytes], tuple[Values, int]]
_READERS: dict[str, tuple[tuple[str, ...], Callable[[], _Reader]]] = {
    TRACKED_TRANSFORM: ((*_STAMPED, "status uint8"), lambda: _tracked),
    TF_MESSAGE: (tuple(f"transforms[].{field}" for field in _STAMPED), lambda: _tf),
    JOINT_STATE: ((*_HEADER, *_ARRAYS), _JointReader),
}
