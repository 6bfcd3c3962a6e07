"""Parameters of ROS as plain Python values, and back.

============= =====================================
in ROS        here
============= =====================================
not set       None
bool          bool
integer       int, 64 bit
double        float
string        str
byte[]        bytes
bool[] ...    a tuple of the same
============= =====================================
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterType, ParameterValue

from app.bridge.convert.errors import ConversionError

Scalar = bool | int | float | str
Plain = Scalar | bytes | tuple[bool, ...] | tuple[int, ...] | tuple[float, ...] | tuple[str, ...]
Settable = Plain | Sequence[Scalar] | NDArray[np.generic] | None
"""What a parameter can be set to; an empty list has no type, an empty numpy array has one."""

TYPE_NAMES = {
    ParameterType.PARAMETER_NOT_SET: "",
    ParameterType.PARAMETER_BOOL: "bool",
    ParameterType.PARAMETER_INTEGER: "integer",
    ParameterType.PARAMETER_DOUBLE: "double",
    ParameterType.PARAMETER_STRING: "string",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte[]",
    ParameterType.PARAMETER_BOOL_ARRAY: "bool[]",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer[]",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double[]",
    ParameterType.PARAMETER_STRING_ARRAY: "string[]",
}
"""Names of the types; empty for a parameter that is not set."""

_FIELDS = {
    ParameterType.PARAMETER_BOOL: "bool_value",
    ParameterType.PARAMETER_INTEGER: "integer_value",
    ParameterType.PARAMETER_DOUBLE: "double_value",
    ParameterType.PARAMETER_STRING: "string_value",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte_array_value",
    ParameterType.PARAMETER_BOOL_ARRAY: "bool_array_value",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer_array_value",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double_array_value",
    ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
}
_SCALARS = (
    (bool, ParameterType.PARAMETER_BOOL),
    (int, ParameterType.PARAMETER_INTEGER),
    (float, ParameterType.PARAMETER_DOUBLE),
    (str, ParameterType.PARAMETER_STRING),
)
_ARRAY_OF = {
    ParameterType.PARAMETER_BOOL: ParameterType.PARAMETER_BOOL_ARRAY,
    ParameterType.PARAMETER_INTEGER: ParameterType.PARAMETER_INTEGER_ARRAY,
    ParameterType.PARAMETER_DOUBLE: ParameterType.PARAMETER_DOUBLE_ARRAY,
    ParameterType.PARAMETER_STRING: ParameterType.PARAMETER_STRING_ARRAY,
}
_ARRAYS = {
    "b": ParameterType.PARAMETER_BOOL_ARRAY,
    "i": ParameterType.PARAMETER_INTEGER_ARRAY,
    "u": ParameterType.PARAMETER_INTEGER_ARRAY,
    "f": ParameterType.PARAMETER_DOUBLE_ARRAY,
    "U": ParameterType.PARAMETER_STRING_ARRAY,
}
_INT64 = 2**63


def plain_value(message: ParameterValue) -> Plain | None:
    """The value of a parameter; None when it is not set."""
    if message.type == ParameterType.PARAMETER_NOT_SET:
        return None
    if message.type not in _FIELDS:
        raise ConversionError(f"a parameter has type {message.type}: 0 to {max(_FIELDS)} wanted")
    value = getattr(message, _FIELDS[message.type])
    if message.type == ParameterType.PARAMETER_BYTE_ARRAY:
        return b"".join(value)
    return value if isinstance(value, Scalar) else tuple(value)


def parameter_value(value: Settable) -> ParameterValue:
    """A message of ``value``; raises `ConversionError` for what no parameter can hold."""
    if value is None:
        return ParameterValue(type=ParameterType.PARAMETER_NOT_SET)
    if isinstance(value, bytes):
        return ParameterValue(
            type=ParameterType.PARAMETER_BYTE_ARRAY,
            byte_array_value=[bytes([byte]) for byte in value],
        )
    if isinstance(value, np.ndarray):
        return _array(value)
    kind = _scalar_type(value)
    if kind is not None:
        return ParameterValue(type=kind, **{_FIELDS[kind]: value})
    return _sequence(value)


def _array(array: NDArray[np.generic]) -> ParameterValue:
    kind = _ARRAYS.get(array.dtype.kind)
    if kind is None or array.ndim != 1:
        raise ConversionError(
            f"an array of {array.dtype} and shape {array.shape} is no value of a parameter: "
            "one dimension of bool, integers, floats or strings wanted"
        )
    values = array.tolist()
    for value in values:
        _scalar_type(value)
    return ParameterValue(type=kind, **{_FIELDS[kind]: values})


def _sequence(values: object) -> ParameterValue:
    if not isinstance(values, list | tuple):
        raise ConversionError(f"{type(values).__name__} is no value of a parameter: {values!r:.80}")
    kinds = {_scalar_type(value) for value in values}
    if not kinds:
        raise ConversionError("an empty list has no type: give an empty numpy array of one")
    if kinds == {ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE}:
        kinds, values = {ParameterType.PARAMETER_DOUBLE}, [float(value) for value in values]
    kind = kinds.pop()
    if kinds or kind is None:
        raise ConversionError(f"a list for a parameter mixes types: {values!r:.80}")
    kind = _ARRAY_OF[kind]
    return ParameterValue(type=kind, **{_FIELDS[kind]: list(values)})


def _scalar_type(value: object) -> int | None:
    for kind, number in _SCALARS:
        if isinstance(value, kind):
            if kind is int and not -_INT64 <= value < _INT64:  # type: ignore[operator]
                raise ConversionError(f"{value} is no value of a parameter: 64 bit wanted")
            return int(number)
    return None
