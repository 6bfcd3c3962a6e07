"""Decoders of ROS messages: from CDR bytes to the values of `app.case.messages.values`."""

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from app.case.messages.cdr_reader import bytes_reader
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    ros_types,
)
from app.case.messages.values import joint_values, tf_values, time_values, tracked_values
from app.geometry import InputError

_DEFINITION_ERRORS = (TypesysError, KeyError, RecursionError)
"""What rosbags raises for unusable definitions; a type that contains itself never ends."""

_VALUES_OF: dict[str, Callable[[Any], Any]] = {
    TRACKED_TRANSFORM: tracked_values,
    TF_MESSAGE: tf_values,
    JOINT_STATE: joint_values,
    TIME_REFERENCE: time_values,
}


def values_reader(message_type: str) -> Callable[[bytes], Any]:
    """A decoder for messages of ``message_type`` from a live topic, in CDR.

    It returns the values that `app.case.messages.values` defines for the type, and raises
    `InputError` for bytes that are not such a message.
    """
    decode = message_decoder(message_type)

    def read(data: bytes) -> Any:
        try:
            return decode(data)
        # What rosbags raises for damaged bytes.
        except (SerdeError, ValueError, IndexError, struct.error, MemoryError) as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise InputError(f"{len(data)} bytes are not a {message_type}: {reason}") from error

    return read


def message_decoder(
    message_type: str, definition: str = "", *, idl: bool = False
) -> Callable[[bytes], Any]:
    """A decoder for messages of ``message_type`` as a recording defines it.

    ``definition`` is a ``ros2msg`` schema, or a ``ros2idl`` one where ``idl``; without one the type
    is taken as ROS 2 Jazzy has it. Raises `InputError` for an unusable definition. The decoder
    raises what rosbags raises for bytes that are not such a message.
    """
    definitions = _definitions(message_type, definition, idl=idl)
    read_bytes = bytes_reader(definitions, message_type)
    values_of = _VALUES_OF[message_type]

    @cache  # slow: built for the first message that needs it
    def types() -> Typestore:
        return _typestore(definitions, message_type) if definition else ros_types()

    if read_bytes is None:
        types()  # raises for an unusable definition

    def decode(data: bytes) -> Any:
        values = None if read_bytes is None else read_bytes(data)
        return values_of(types().deserialize_cdr(data, message_type)) if values is None else values

    return decode


def _definitions(message_type: str, definition: str, *, idl: bool) -> Typesdict:
    if not definition:  # bags from before ROS 2 Iron have none
        return ros_types().fielddefs
    try:
        if idl:
            return get_types_from_idl(definition)
        return get_types_from_msg(definition, message_type)
    except _DEFINITION_ERRORS as error:
        raise _unusable(message_type, error) from error


def _typestore(definitions: Typesdict, message_type: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(definitions)
        store.get_msgdef(message_type)
    except _DEFINITION_ERRORS as error:
        raise _unusable(message_type, error) from error
    return store


def _unusable(message_type: str, error: Exception) -> InputError:
    reason = str(error).splitlines()[0]
    return InputError(f"the definition of {message_type} in the recording cannot be used: {reason}")
