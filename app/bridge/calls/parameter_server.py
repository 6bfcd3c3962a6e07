"""Parameters of our own node, declared with type, unit and range, and values of ROS parameters.

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

import math
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rclpy.parameter import Parameter

from app.bridge.node import RosNode
from app.bridge.ros_errors import CallError, ConversionError, reason_of
from app.geometry import MarginGuardError

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
    kind: f"{name.replace('[]', '_array')}_value" for kind, name in TYPE_NAMES.items() if name
}
_SCALARS = (
    (bool, ParameterType.PARAMETER_BOOL),
    (int, ParameterType.PARAMETER_INTEGER),
    (float, ParameterType.PARAMETER_DOUBLE),
    (str, ParameterType.PARAMETER_STRING),
)
_ARRAYS = {
    "b": ParameterType.PARAMETER_BOOL_ARRAY,
    "i": ParameterType.PARAMETER_INTEGER_ARRAY,
    "u": ParameterType.PARAMETER_INTEGER_ARRAY,
    "f": ParameterType.PARAMETER_DOUBLE_ARRAY,
    "U": ParameterType.PARAMETER_STRING_ARRAY,
}
"""By the kind of a numpy type."""

_KINDS = {name: kind for kind, name in TYPE_NAMES.items()}
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
    kind = _KINDS[f"{TYPE_NAMES[kind]}[]"]
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


@dataclass(frozen=True, slots=True)
class ParameterDeclaration:
    """Name, initial value (which fixes the type), description and unit of a parameter.

    The range from ``lowest`` to ``highest`` includes both ends. Without a range a float must be
    finite. Raises `CallError` if the initial value is outside the range.
    """

    name: str
    value: Plain
    text: str
    unit: str = ""
    lowest: float | None = None
    highest: float | None = None

    def __post_init__(self) -> None:
        if (self.lowest is None) != (self.highest is None):
            raise CallError(
                f"parameter {self.name}: range from {self.lowest} to {self.highest}; "
                "expected both ends or none"
            )
        problem = self.problem(self.value)
        if problem:
            raise CallError(problem)

    def problem(self, value: object) -> str:
        """The reason why ``value`` is invalid; empty if it is valid."""
        if type(value) is not type(self.value):
            return f"{self.name} is {value!r:.80}; expected {type(self.value).__name__}"
        numbers = value if isinstance(value, tuple) else (value,)
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | float):
                continue
            if self.lowest is not None and self.highest is not None:
                if not self.lowest <= number <= self.highest:
                    return (
                        f"{self.name} is {number:g}; expected {self.lowest:g} to "
                        f"{self.highest:g} {self.unit}".rstrip()
                    )
            elif not math.isfinite(number):
                return f"{self.name} is {number}; expected a finite number"
        return ""

    def descriptor(self) -> ParameterDescriptor:
        """The ROS descriptor of the parameter."""
        message = ParameterDescriptor(
            description=self.text,
            additional_constraints=f"unit: {self.unit}" if self.unit else "",
        )
        if self.lowest is not None and self.highest is not None:
            if isinstance(self.value, int):
                message.integer_range = [
                    IntegerRange(from_value=int(self.lowest), to_value=int(self.highest))
                ]
            elif isinstance(self.value, float):
                message.floating_point_range = [
                    FloatingPointRange(from_value=float(self.lowest), to_value=float(self.highest))
                ]
        return message


class ParameterServer:
    """Declares ``parameters`` on ``ros`` and validates every change.

    ``accept(values)`` receives the complete candidate set and raises `MarginGuardError` to refuse
    it; then no value changes and the caller gets the reason. It runs in the node's thread, after
    the values have passed their declarations. Overrides at start-up (``--ros-args -p``) are
    validated in the same way; raises `CallError` if they are refused.

    ``on_refusal(reason)`` is called for each refused request.

    ROS applies ``set_parameters`` one parameter at a time. Values that depend on each other need
    ``set_parameters_atomically``.
    """

    def __init__(
        self,
        ros: RosNode,
        parameters: Iterable[ParameterDeclaration],
        accept: Callable[[Mapping[str, Plain]], None] | None = None,
        on_refusal: Callable[[str], None] = lambda reason: None,
    ) -> None:
        self.refused = 0
        self._on_refusal = on_refusal
        self._ros = ros
        self._declared = {parameter.name: parameter for parameter in parameters}
        self._accept = accept
        self._lock = threading.Lock()
        self._values = {name: each.value for name, each in self._declared.items()}
        initial: dict[str, Plain | None] = {}
        for name, each in self._declared.items():
            try:
                declared = ros.node.declare_parameter(name, each.value, each.descriptor())
            except Exception as error:  # rclpy has an unrelated type for each way to refuse
                raise CallError(
                    f"parameter {name} cannot be declared: {reason_of(error)}"
                ) from error
            initial[name] = plain_value(declared.get_parameter_value())
        reason = self._apply(initial)
        if reason:
            raise CallError(f"initial parameters: {reason}")
        ros.node.add_on_set_parameters_callback(self._on_set)

    @property
    def values(self) -> Mapping[str, Plain]:
        """Consistent copy of all values."""
        with self._lock:
            return dict(self._values)

    def close(self) -> None:
        """Undeclare the parameters."""
        self._ros.node.remove_on_set_parameters_callback(self._on_set)
        for name in self._declared:
            self._ros.node.undeclare_parameter(name)

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        requested = {
            each.name: plain_value(each.get_parameter_value())
            for each in parameters
            if each.name in self._declared
        }
        try:
            reason = self._apply(requested)
        except Exception as error:  # raised by `accept`; the caller must get a reply
            reason = f"the server failed: {type(error).__name__}: {error}"
        if reason:
            self.refused += 1
            self._on_refusal(reason)
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply(self, requested: Mapping[str, Plain | None]) -> str:
        """Validate and store the values; returns the reason if they are refused."""
        for name, value in requested.items():
            problem = self._declared[name].problem(value)
            if problem:
                return problem
        candidate = {**self.values}
        candidate.update((name, value) for name, value in requested.items() if value is not None)
        if self._accept is not None:
            try:
                self._accept(candidate)
            except MarginGuardError as error:
                return str(error)
        with self._lock:
            self._values = candidate
        return ""
