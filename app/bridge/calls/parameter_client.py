"""The parameters of another node: list, read, set, describe, and hear of their changes."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterEvent
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.qos import qos_profile_parameter_events
from rclpy.subscription import Subscription

from app.bridge.calls.errors import CallError, ParameterUnsetError, RefusedError
from app.bridge.calls.parameter_values import (
    TYPE_NAMES,
    Plain,
    Settable,
    parameter_value,
    plain_value,
)
from app.bridge.calls.service_client import ServiceClient
from app.bridge.calls.waiting import DEFAULT_TIMEOUT_S
from app.bridge.convert.errors import ConversionError
from app.bridge.node import RosNode
from app.bridge.qos import Topic

_EVENTS = Topic("/parameter_events", ParameterEvent, qos_profile_parameter_events)
_REPEAT_S = 1.0
"""To ask or to set a second time changes nothing."""

_SERVICES = {
    "list_parameters": ListParameters,
    "get_parameters": GetParameters,
    "get_parameter_types": GetParameterTypes,
    "set_parameters": SetParameters,
    "set_parameters_atomically": SetParametersAtomically,
    "describe_parameters": DescribeParameters,
}


@dataclass(frozen=True, slots=True)
class ParameterDescription:
    """What a node says of a parameter; ``lowest`` and ``highest`` are None without a range."""

    name: str
    type: str
    text: str
    constraints: str
    read_only: bool
    lowest: float | None
    highest: float | None


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """What `/parameter_events` tells of the node: new values, and names that are gone."""

    values: Mapping[str, Plain | None]
    deleted: tuple[str, ...]


class ParameterClient:
    """``ParameterClient(ros, "/robot_state_publisher").get("robot_description")``.

    Every call finds the node and has its answer within ``timeout_s``, or ends when ``cancel`` is
    set in another thread. Raises `NotThereError`, `ServerGoneError`, `CallTimeoutError`,
    `CallCancelledError`, and what each method names.
    """

    def __init__(self, ros: RosNode, node: str) -> None:
        self._ros = ros
        if not node.strip("/"):
            raise CallError("the name of the node whose parameters are wanted is empty")
        self._services = {
            name: ServiceClient(ros, kind, f"{node.rstrip('/')}/{name}")
            for name, kind in _SERVICES.items()
        }
        self.node = self._services["get_parameters"].name.removesuffix("/get_parameters")
        self._watchers: list[Callable[[ParameterChange], None]] = []
        self._events: Subscription | None = None

    @property
    def is_there(self) -> bool:
        """Whether the node serves its parameters now."""
        return self._services["get_parameters"].is_there

    @property
    def late_replies(self) -> int:
        """Replies that came after their callers had given up."""
        return sum(service.late_replies for service in self._services.values())

    def names(
        self,
        *prefixes: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> tuple[str, ...]:
        """The names of the node's parameters, below the ``prefixes`` when there are any."""
        request = ListParameters.Request(prefixes=list(prefixes), depth=0)
        reply = self._call("list_parameters", request, timeout_s, cancel)
        return tuple(reply.result.names)

    def get(
        self,
        name: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> Plain:
        """The value of one parameter; raises `ParameterUnsetError`."""
        return self.get_many((name,), timeout_s, cancel)[name]

    def get_many(
        self,
        names: Sequence[str],
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> dict[str, Plain]:
        """The values of several at one moment; `ParameterUnsetError` when any of them has none."""
        request = GetParameters.Request(names=list(names))
        values = self._call("get_parameters", request, timeout_s, cancel).values
        # One name that is not declared leaves the whole reply empty, in rclpy and rclcpp alike.
        if len(values) != len(names):
            raise ParameterUnsetError(f"{self.node} has not declared {_listed(names)}")
        found = {name: plain_value(value) for name, value in zip(names, values, strict=True)}
        unset = [name for name, value in found.items() if value is None]
        if unset:
            raise ParameterUnsetError(f"{self.node} has no value for {_listed(unset)}")
        return {name: value for name, value in found.items() if value is not None}

    def type_of(
        self,
        name: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> str:
        """``integer``, ``double[]`` ...; empty for a parameter that is not set or not declared."""
        request = GetParameterTypes.Request(names=[name])
        types = self._call("get_parameter_types", request, timeout_s, cancel).types
        return TYPE_NAMES.get(types[0], f"type {types[0]}") if len(types) == 1 else ""

    def is_set(
        self,
        name: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> bool:
        """Whether the parameter is declared and has a value."""
        return self.type_of(name, timeout_s, cancel) != ""

    def set(
        self,
        values: Mapping[str, Settable],
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> None:
        """Set each for itself; `RefusedError` names those that were refused, the others are set."""
        request = SetParameters.Request(parameters=_messages(values))
        results = self._call("set_parameters", request, timeout_s, cancel).results
        if len(results) != len(values):
            raise CallError(f"{self.node} answered {len(results)} of {len(values)} settings")
        refused = [
            f"{name}: {result.reason}"
            for name, result in zip(values, results, strict=True)
            if not result.successful
        ]
        if refused:
            raise RefusedError(f"{self.node} refused {'; '.join(refused)}")

    def set_atomically(
        self,
        values: Mapping[str, Settable],
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> None:
        """Set all of them or none; raises `RefusedError` with the node's reason."""
        request = SetParametersAtomically.Request(parameters=_messages(values))
        result = self._call("set_parameters_atomically", request, timeout_s, cancel).result
        if not result.successful:
            raise RefusedError(f"{self.node} refused {_listed(tuple(values))}: {result.reason}")

    def describe(
        self,
        name: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> ParameterDescription:
        """Type, text and range; raises `ParameterUnsetError` when it is not declared."""
        request = DescribeParameters.Request(names=[name])
        descriptors = self._call("describe_parameters", request, timeout_s, cancel).descriptors
        if len(descriptors) != 1:
            raise ParameterUnsetError(f"{self.node} has not declared {name}")
        return _description(descriptors[0])

    def watch(self, changed: Callable[[ParameterChange], None]) -> None:
        """Call ``changed(change)`` in our node's thread whenever the other's parameters change."""
        self._watchers.append(changed)
        if self._events is None:
            self._events = self._ros.subscribe(_EVENTS, self._take_event)

    def close(self) -> None:
        """Leave the graph; needed only before the node itself is closed, in the node's thread."""
        for service in self._services.values():
            service.close()
        if self._events is not None:
            self._ros.unsubscribe(self._events)

    def _take_event(self, event: ParameterEvent) -> None:
        if event.node != self.node:
            return
        try:
            values = {
                parameter.name: plain_value(parameter.value)
                for parameter in (*event.new_parameters, *event.changed_parameters)
            }
        except ConversionError as error:
            self._ros.node.get_logger().warning(f"an event of {self.node} is left out: {error}")
            return
        change = ParameterChange(values, tuple(gone.name for gone in event.deleted_parameters))
        for changed in self._watchers:
            changed(change)

    def _call(
        self, service: str, request: Any, timeout_s: float, cancel: threading.Event | None
    ) -> Any:
        return self._services[service].call(request, timeout_s, cancel, repeat_s=_REPEAT_S)


def _messages(values: Mapping[str, Settable]) -> list[Parameter]:
    return [Parameter(name=name, value=parameter_value(value)) for name, value in values.items()]


def _description(message: ParameterDescriptor) -> ParameterDescription:
    ranges = (*message.floating_point_range, *message.integer_range)
    return ParameterDescription(
        name=message.name,
        type=TYPE_NAMES.get(message.type, f"type {message.type}"),
        text=message.description,
        constraints=message.additional_constraints,
        read_only=message.read_only,
        lowest=float(ranges[0].from_value) if ranges else None,
        highest=float(ranges[0].to_value) if ranges else None,
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names)
