"""Values of pose and joint messages straight from their CDR bytes.

A minute of recording holds some ten thousand messages, and rosbags makes an object of every field
of each. Here the few numbers that are used are taken from where the layout has them. Bytes that are
not exactly such a message (a name without its terminating zero, a wrong length) give None: rosbags
then decides whether they are a message at all.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import zip_longest
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict

from app.case.messages.cdr_layout import Known, LayoutReader, Walk
from app.case.messages.ros_messages import JOINT_STATE, TF_MESSAGE, TRACKED_TRANSFORM
from app.case.messages.values import JointValues, PoseValues, frame_name
from app.geometry import NS_PER_S

_POSE_NUMBERS = 10
"""Values of a stamped transform: two of its stamp, its names, seven of its pose."""
_MIN_POSE_BYTES = 4 + 4 + 4 + 1 + 4 + 1 + 7 * 8
"""A stamped transform with two empty names, less its padding."""
_MAX_FRAME_BYTES = 1024
"""Longest name of a frame that is read here, with its terminating zero."""


def bytes_reader(definitions: Typesdict, message_type: str) -> LayoutReader[Any] | None:
    """A reader for messages of ``message_type``; None where its definition is not the known one."""
    fields, make_reader = _READERS.get(message_type, ((), None))
    try:
        # Stops at the first difference: a type that holds others twice, and so on, has no end.
        pairs = zip_longest(_fields(definitions, message_type), fields)
        is_known = all(found == expected for found, expected in pairs)
    except (KeyError, RecursionError):
        is_known = False
    return make_reader() if make_reader is not None and is_known else None


def tf_reader() -> Callable[[bytes], tuple[PoseValues, ...]]:
    """A reader for ``tf2_msgs/TFMessage`` that leaves the names of frames as they were sent.

    It raises `ValueError` with the reason for bytes that are not such a message.
    """
    return LayoutReader(partial(_walk_tf, as_frame=str), _tf).read


def _walk_pose(walk: Walk, as_frame: Callable[[str], str] = frame_name) -> Known:
    """The fields that `TrackedTransform` and `TransformStamped` have in common."""
    walk.align(4)
    walk.numbers("iI", 8)
    names = as_frame(walk.text(_MAX_FRAME_BYTES)), as_frame(walk.text(_MAX_FRAME_BYTES))
    walk.align(8)
    known = {walk.fixed(): names}
    walk.numbers("7d", 56)
    return known


def _walk_tracked(walk: Walk) -> Known:
    known = _walk_pose(walk)
    walk.numbers("B", 1)
    return known


def _tracked(numbers: tuple[Any, ...], known: Known) -> PoseValues:
    sec, nanosec, names, x, y, z, qx, qy, qz, qw, status = numbers
    target, source = known[names]
    return PoseValues(target, source, sec * NS_PER_S + nanosec, (x, y, z), (qx, qy, qz, qw), status)


def _walk_tf(walk: Walk, as_frame: Callable[[str], str] = frame_name) -> Known:
    count = walk.count(_MIN_POSE_BYTES)
    known = {walk.fixed(): count}
    for _ in range(count):
        known |= _walk_pose(walk, as_frame)
    return known


def _tf(numbers: tuple[Any, ...], known: Known) -> tuple[PoseValues, ...]:
    poses = []
    for first in range(1, 1 + _POSE_NUMBERS * known[numbers[0]], _POSE_NUMBERS):
        sec, nanosec, names, x, y, z, qx, qy, qz, qw = numbers[first : first + _POSE_NUMBERS]
        target, source = known[names]
        ns = sec * NS_PER_S + nanosec
        poses.append(PoseValues(target, source, ns, (x, y, z), (qx, qy, qz, qw)))
    return tuple(poses)


def _walk_joints(walk: Walk) -> Known:
    walk.numbers("iI", 8)
    walk.text()
    names = tuple([walk.text() for _ in range(walk.count())])
    stretches = [_walk_floats(walk, "d")]
    stretches += [_walk_floats(walk, "x") for _ in ("velocity", "effort")]
    return {b"".join(stretches): names}


def _walk_floats(walk: Walk, code: str) -> bytes:
    """Skip an array of doubles, dropped where ``code`` is ``x``; returns the stretch before it."""
    count = walk.count()
    if count:
        walk.align(8)
    stretch = walk.fixed()
    walk.numbers(f"{count}d" if code == "d" else f"{8 * count}x", 8 * count)
    return stretch


def _joints(numbers: tuple[Any, ...], known: Known) -> JointValues:
    sec, nanosec, names, *positions, velocity, effort = numbers
    return JointValues(known[names + velocity + effort], tuple(positions), sec * NS_PER_S + nanosec)


def _fields(definitions: Typesdict, message_type: str, prefix: str = "") -> Iterator[str]:
    """Path and type of every value in a message, in order; the path alone of an empty message."""
    # A field is (kind, content): a name, (basic type, bound) or, for a sequence, (field, bound).
    fields: list[tuple[str, Any]] = list(definitions[message_type][1])
    if not fields:
        yield prefix
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
_READERS: dict[str, tuple[tuple[str, ...], Callable[[], LayoutReader[Any]]]] = {
    TRACKED_TRANSFORM: (
        (*_STAMPED, "status uint8"),
        lambda: LayoutReader(_walk_tracked, _tracked),
    ),
    TF_MESSAGE: (
        tuple(f"transforms[].{field}" for field in _STAMPED),
        lambda: LayoutReader(_walk_tf, _tf),
    ),
    JOINT_STATE: ((*_HEADER, *_ARRAYS), lambda: LayoutReader(_walk_joints, _joints)),
}
