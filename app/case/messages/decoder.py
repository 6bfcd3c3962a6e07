"""Decoders of ROS messages: from CDR bytes to the values of `app.case.messages.message_values`.

A recording has its own definitions of the types, which may be hostile. Their text is limited,
because the parser of rosbags needs up to 0.1 ms per character, and so is the number of values that
a message has by its definition, because rosbags generates code for all of them.

A minute of recording holds some ten thousand messages, and rosbags makes an object of every field
of each. Of pose and joint messages the few numbers that are used are taken from where the layout
has them. Bytes that are not exactly such a message (a name without its terminating zero, a wrong
length) give None: rosbags then decides whether they are a message at all.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache, partial
from itertools import zip_longest
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.case.messages.cdr_batch import Batch
from app.case.messages.cdr_layout import Known, LayoutReader, Walk
from app.case.messages.message_values import (
    JointValues,
    PoseValues,
    bool_value,
    frame_name,
    joint_values,
    range_values,
    tf_values,
    time_values,
    tracked_values,
)
from app.case.messages.ros_messages import (
    BOOL,
    JOINT_STATE,
    RANGE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    ros_types,
)
from app.geometry import NS_PER_S, InputError

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


MAX_DEFINITION_CHARS = 16 * 1024
"""Maximum length of a definition with its nested ones; those used here have 3 thousand."""

_MAX_VALUES = 256
"""Rosbags generates code for each; the types used here have 13 or fewer."""
_MAX_DEPTH = 16
"""Largest depth of nested types; more only occurs where a type contains itself."""

_VALUES_OF: dict[str, Callable[[Any], Any]] = {
    TRACKED_TRANSFORM: tracked_values,
    TF_MESSAGE: tf_values,
    JOINT_STATE: joint_values,
    TIME_REFERENCE: time_values,
    BOOL: bool_value,
    RANGE: range_values,
}


class MessageDecoder:
    """Decodes messages of one type; made by `message_decoder`."""

    def __init__(
        self, decode: Callable[[bytes], Any], read_bytes: LayoutReader[Any] | None
    ) -> None:
        self._decode = decode
        self._read_bytes = read_bytes

    def __call__(self, data: bytes) -> Any:
        """The values of one message; raises `InputError` for bytes that are not such a message."""
        return self._decode(data)

    def batch(self, messages: Sequence[bytes], decode: Batch) -> list[Any]:
        """The samples of ``messages`` of one length by ``decode`` of `app.case.messages.cdr_batch`.

        None for each message that has to be decoded by itself.
        """
        if self._read_bytes is None:
            return [None] * len(messages)
        return self._read_bytes.batch(messages, decode)


def message_decoder(
    message_type: str, definition: str = "", *, idl: bool = False
) -> MessageDecoder:
    """A decoder for messages of ``message_type`` as a recording defines it.

    ``definition`` is a ``ros2msg`` schema, or a ``ros2idl`` one where ``idl``; without one the type
    is taken as ROS 2 Jazzy has it, as for a live topic. Raises `InputError` for an unusable
    definition. The decoder returns the values that `app.case.messages.message_values` defines for
    the type, and raises `InputError` for bytes that are not such a message.
    """
    definitions = _definitions(message_type, definition, idl=idl)
    read_bytes = bytes_reader(definitions, message_type)
    values_of = _VALUES_OF[message_type]

    @cache  # slow: built for the first message that needs it
    def types() -> Typestore:
        return _typestore(message_type, definition, idl=idl) if definition else ros_types()

    if read_bytes is None:
        types()  # raises for an unusable definition

    def decode(data: bytes) -> Any:
        values = None if read_bytes is None else read_bytes(data)
        if values is not None:
            return values
        try:
            return values_of(types().deserialize_cdr(data, message_type))
        except InputError:
            raise
        except Exception as error:  # rosbags raises many kinds of errors for damaged bytes
            raise InputError(
                f"{len(data)} bytes are not a {message_type}: {_reason(error)}"
            ) from error

    return MessageDecoder(decode, read_bytes)


# Recordings have the same few definitions, which take some 20 ms each.
@lru_cache(maxsize=16)
def _definitions(message_type: str, definition: str, *, idl: bool) -> Typesdict:
    if not definition:  # bags from before ROS 2 Iron have none
        return ros_types().fielddefs
    if len(definition) > MAX_DEFINITION_CHARS:
        raise InputError(
            f"the definition of {message_type} in the recording cannot be used: it has "
            f"{len(definition)} characters; expected {MAX_DEFINITION_CHARS} or less"
        )
    try:
        if idl:
            found = get_types_from_idl(definition)
        else:
            found = get_types_from_msg(definition, message_type)
        count = _count_values(found, message_type, 0)
    except Exception as error:  # rosbags raises many kinds of errors for hostile text
        raise _unusable(message_type, _reason(error)) from error
    if count > _MAX_VALUES:
        raise _unusable(message_type, f"more than {_MAX_VALUES} values; expected fewer")
    return found


def _count_values(definitions: Typesdict, message_type: str, depth: int) -> int:
    """Number of values of a message, each sequence counted as one item; stops above the limit.

    Raises `ValueError` for a type that contains itself, and `KeyError` for an unknown one.
    """
    if depth > _MAX_DEPTH:
        raise ValueError(f"types are nested deeper than {_MAX_DEPTH}")
    count = 0
    # A field is (kind, content): a name, (basic type, bound) or ((kind, content), number of items).
    fields: list[tuple[str, Any]] = list(definitions[message_type][1])
    for _, (kind, of) in fields:
        items = 1
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            items = int(of[1]) if kind == Nodetype.ARRAY else 1
            kind, of = of[0]
        count += items * (
            _count_values(definitions, str(of), depth + 1) if kind == Nodetype.NAME else 1
        )
        if count > _MAX_VALUES:
            return count
    return count


@lru_cache(maxsize=16)
def _typestore(message_type: str, definition: str, *, idl: bool) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(_definitions(message_type, definition, idl=idl))
        store.get_msgdef(message_type)
    except Exception as error:  # as for the definitions
        raise _unusable(message_type, _reason(error)) from error
    return store


def _unusable(message_type: str, reason: str) -> InputError:
    return InputError(f"the definition of {message_type} in the recording cannot be used: {reason}")


def _reason(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0][:200]
