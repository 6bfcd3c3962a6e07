"""Conversion between ROS parameter values and plain Python values.

============= =====================================
ROS           Python
============= =====================================
not set       None
bool          bool
integer       int, 64 bit
double        float
string        str
byte[]        bytes
bool[] ...    tuple of the element type
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
"""Values that a parameter can be set to. An empty list must be an empty numpy array, which has a
type."""

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
"""Type names; empty for a parameter that is not set."""

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
    """Convert a ROS parameter value; None if it is not set. Raises `ConversionError`."""
    if message.type == ParameterType.PARAMETER_NOT_SET:
        return None
    if message.type not in _FIELDS:
        raise ConversionError(f"parameter type is {message.type}; expected 0 to {max(_FIELDS)}")
    value = getattr(message, _FIELDS[message.type])
    if message.type == ParameterType.PARAMETER_BYTE_ARRAY:
        return b"".join(value)
    return value if isinstance(value, Scalar) else tuple(value)


def parameter_value(value: Settable) -> ParameterValue:
    """Convert ``value`` to a ROS parameter value; raises `ConversionError`."""
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
            f"parameter value is an array of {array.dtype} with shape {array.shape}; "
            "expected one dimension of bool, integer, float or string"
        )
    values = array.tolist()
    for value in values:
        _scalar_type(value)
    return ParameterValue(type=kind, **{_FIELDS[kind]: values})


def _sequence(values: object) -> ParameterValue:
    if not isinstance(values, list | tuple):
        raise ConversionError(
            f"parameter value {values!r:.80} is a {type(values).__name__}; "
            "expected a scalar, bytes, list, tuple or numpy array"
        )
    kinds = {_scalar_type(value) for value in values}
    if not kinds:
        raise ConversionError(
            "parameter value is an empty list, which has no type; expected an empty numpy array"
        )
    if kinds == {ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE}:
        kinds, values = {ParameterType.PARAMETER_DOUBLE}, [float(value) for value in values]
    kind = kinds.pop()
    if kinds or kind is None:
        raise ConversionError(
            f"parameter value {values!r:.80} mixes types; expected elements of one type"
        )
    kind = _ARRAY_OF[kind]
    return ParameterValue(type=kind, **{_FIELDS[kind]: list(values)})


def _scalar_type(value: object) -> int | None:
    for kind, number in _SCALARS:
        if isinstance(value, kind):
            if kind is int and not -_INT64 <= value < _INT64:  # type: ignore[operator]
                raise ConversionError(
                    f"parameter value {value} is out of range; expected a signed 64-bit integer"
                )
            return int(number)
    return None
