"""Parameters of our own node: declared with type, unit and range, refused whole when invalid."""

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter

from app.bridge.calls.errors import CallError
from app.bridge.calls.parameter_values import Plain, plain_value
from app.bridge.errors import reason_of
from app.bridge.node import RosNode
from app.geometry import MarginGuardError


@dataclass(frozen=True, slots=True)
class ParameterDeclaration:
    """A parameter's name and first value, which gives its type; what it means, in which unit.

    ``lowest`` and ``highest`` are allowed themselves; a float must be finite unless its range
    says otherwise. Raises `CallError` for a value that its own range refuses.
    """

    name: str
    value: Plain
    text: str
    unit: str = ""
    lowest: float | None = None
    highest: float | None = None
    read_only: bool = False

    def __post_init__(self) -> None:
        if (self.lowest is None) != (self.highest is None):
            raise CallError(f"parameter {self.name}: a range has two ends")
        problem = self.problem(self.value)
        if problem:
            raise CallError(problem)

    def problem(self, value: object) -> str:
        """Why ``value`` cannot be set; empty when it can."""
        if type(value) is not type(self.value):
            wanted = type(self.value).__name__
            return f"{self.name} is {value!r:.80}: {wanted} wanted"
        numbers = value if isinstance(value, tuple) else (value,)
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | float):
                continue
            if self.lowest is not None and self.highest is not None:
                if not self.lowest <= number <= self.highest:
                    return (
                        f"{self.name} is {number:g}: {self.lowest:g} to {self.highest:g} "
                        f"{self.unit} wanted".replace("  ", " ")
                    )
            elif not math.isfinite(number):
                return f"{self.name} is {number}: a finite number wanted"
        return ""

    def descriptor(self) -> ParameterDescriptor:
        """What others are told of it."""
        message = ParameterDescriptor(
            description=self.text,
            additional_constraints=f"unit: {self.unit}" if self.unit else "",
            read_only=self.read_only,
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
    """Declares ``parameters`` on ``ros``, and keeps every set of values that it gives out valid.

    ``accept(values)`` gets all values as they would be, and raises `MarginGuardError` to refuse
    them: then none of them is changed and the caller is told the reason. It runs in the node's
    thread, and only for values that fit their declarations. Values given to the node at its start
    (``--ros-args -p``) go the same way; raises `CallError` when they are refused.

    A request by ``set_parameters`` sets one after the other, as ROS has it everywhere:
    ``set_parameters_atomically`` is for values that depend on each other.
    """

    def __init__(
        self,
        ros: RosNode,
        parameters: Iterable[ParameterDeclaration],
        accept: Callable[[Mapping[str, Plain]], None] | None = None,
    ) -> None:
        self.refused = 0
        self._ros = ros
        self._declared = {parameter.name: parameter for parameter in parameters}
        self._accept = accept
        self._lock = threading.Lock()
        self._values = {name: each.value for name, each in self._declared.items()}
        started: dict[str, Plain | None] = {}
        for name, each in self._declared.items():
            try:
                declared = ros.node.declare_parameter(name, each.value, each.descriptor())
            except Exception as error:  # rclpy has an unrelated type for each way to refuse
                raise CallError(
                    f"parameter {name} cannot be declared: {reason_of(error)}"
                ) from error
            started[name] = plain_value(declared.get_parameter_value())
        reason = self._take(started)
        if reason:
            raise CallError(f"parameters at the start: {reason}")
        ros.node.add_on_set_parameters_callback(self._asked)

    @property
    def values(self) -> Mapping[str, Plain]:
        """All values, as they were at one moment."""
        with self._lock:
            return dict(self._values)

    def close(self) -> None:
        """Declare them no more; read-only ones stay with the node, as ROS has it."""
        self._ros.node.remove_on_set_parameters_callback(self._asked)
        for name, each in self._declared.items():
            if not each.read_only:
                self._ros.node.undeclare_parameter(name)

    def _asked(self, parameters: list[Parameter]) -> SetParametersResult:
        asked = {
            each.name: plain_value(each.get_parameter_value())
            for each in parameters
            if each.name in self._declared
        }
        try:
            reason = self._take(asked)
        except Exception as error:  # of `accept`; the caller must have an answer
            reason = f"the server failed: {type(error).__name__}: {error}"
        if reason:
            self.refused += 1
        return SetParametersResult(successful=not reason, reason=reason)

    def _take(self, asked: Mapping[str, Plain | None]) -> str:
        """Take the values over; the reason when they are refused, and nothing is taken."""
        for name, value in asked.items():
            problem = self._declared[name].problem(value)
            if problem:
                return problem
        candidate = {**self.values}
        candidate.update((name, value) for name, value in asked.items() if value is not None)
        if self._accept is not None:
            try:
                self._accept(candidate)
            except MarginGuardError as error:
                return str(error)
        with self._lock:
            self._values = candidate
        return ""
