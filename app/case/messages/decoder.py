"""Decoders of ROS messages: from CDR bytes to the values of `app.case.messages.values`.

A recording has its own definitions of the types, which may be hostile. Their text is limited,
because the parser of rosbags needs up to 0.1 ms per character, and so is the number of values that
a message has by its definition, because rosbags generates code for all of them.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.case.messages.cdr_batch import Batch
from app.case.messages.cdr_layout import LayoutReader
from app.case.messages.cdr_reader import bytes_reader
from app.case.messages.ros_messages import (
    BOOL,
    JOINT_STATE,
    RANGE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    ros_types,
)
from app.case.messages.values import (
    bool_value,
    joint_values,
    range_values,
    tf_values,
    time_values,
    tracked_values,
)
from app.geometry import InputError

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


def values_reader(message_type: str) -> Callable[[bytes], Any]:
    """A decoder for messages of ``message_type`` from a live topic, in CDR.

    It returns the values that `app.case.messages.values` defines for the type, and raises
    `InputError` for bytes that are not such a message.
    """
    return message_decoder(message_type)


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
    is taken as ROS 2 Jazzy has it. Raises `InputError` for an unusable definition. The decoder
    raises it for bytes that are not such a message.
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
