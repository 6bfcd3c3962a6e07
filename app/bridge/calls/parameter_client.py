"""Parameters of another node: get, set, and watch for changes."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterEvent
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.qos import qos_profile_parameter_events
from rclpy.subscription import Subscription

from app.bridge.calls.parameter_server import Plain, Settable, parameter_value, plain_value
from app.bridge.calls.service_client import DEFAULT_TIMEOUT_S, ServiceClient
from app.bridge.node import RosNode
from app.bridge.ros_errors import CallError, ConversionError, ParameterUnsetError, RefusedError
from app.bridge.topics import Topic

_EVENTS = Topic("/parameter_events", ParameterEvent, qos_profile_parameter_events)
_REPEAT_S = 1.0
"""Parameter requests are idempotent and can be repeated."""

_SERVICES = {"get_parameters": GetParameters, "set_parameters": SetParameters}


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """Changes of the node from `/parameter_events`: new values and names of deleted parameters."""

    values: Mapping[str, Plain | None]
    deleted: tuple[str, ...]


class ParameterClient:
    """``ParameterClient(ros, "/robot_state_publisher").get("robot_description")``.

    ``timeout_s`` covers discovery of the node and its reply. Setting ``cancel`` from another
    thread ends the call. Every method raises `ServerUnavailableError`, `ServerGoneError`,
    `CallTimeoutError` and `CallCancelledError` in addition to the errors it documents.
    """

    def __init__(self, ros: RosNode, node: str) -> None:
        self._ros = ros
        if not node.strip("/"):
            raise CallError("parameter client: the node name is empty")
        self._services = {
            name: ServiceClient(ros, kind, f"{node.rstrip('/')}/{name}")
            for name, kind in _SERVICES.items()
        }
        self.node = self._services["get_parameters"].name.removesuffix("/get_parameters")
        self._callbacks: list[Callable[[ParameterChange], None]] = []
        self._events: Subscription | None = None

    @property
    def is_available(self) -> bool:
        """True if the parameter services of the node are discovered."""
        return self._services["get_parameters"].is_available

    def get(
        self,
        name: str,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> Plain:
        """Get the value of one parameter; raises `ParameterUnsetError`."""
        request = GetParameters.Request(names=[name])
        values = self._call("get_parameters", request, timeout_s, cancel).values
        if not values:  # rclpy and rclcpp return none for a name that is not declared
            raise ParameterUnsetError(f"{self.node} has not declared {name!r}")
        value = plain_value(values[0])
        if value is None:
            raise ParameterUnsetError(f"{self.node} has no value for {name!r}")
        return value

    def set(
        self,
        values: Mapping[str, Settable],
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
    ) -> None:
        """Set each value independently; `RefusedError` lists the refused ones, the rest are set."""
        request = SetParameters.Request(parameters=_messages(values))
        results = self._call("set_parameters", request, timeout_s, cancel).results
        if len(results) != len(values):
            raise CallError(f"{self.node} returned {len(results)} results; expected {len(values)}")
        refused = [
            f"{name}: {result.reason}"
            for name, result in zip(values, results, strict=True)
            if not result.successful
        ]
        if refused:
            raise RefusedError(f"{self.node} refused {'; '.join(refused)}")

    def watch(self, changed: Callable[[ParameterChange], None]) -> None:
        """Call ``changed(change)`` in the thread of our node when parameters change."""
        self._callbacks.append(changed)
        if self._events is None:
            self._events = self._ros.subscribe(_EVENTS, self._take_event)

    def close(self) -> None:
        """Destroy the clients, in the node's thread. Closing the node does this as well."""
        for service in self._services.values():
            service.close()
        if self._events is not None:
            self._ros.destroy_subscription(self._events)

    def _take_event(self, event: ParameterEvent) -> None:
        if event.node != self.node:
            return
        try:
            values = {
                parameter.name: plain_value(parameter.value)
                for parameter in (*event.new_parameters, *event.changed_parameters)
            }
        except ConversionError as error:
            self._ros.node.get_logger().warning(
                f"ignored a parameter event of {self.node}: {error}"
            )
            return
        change = ParameterChange(values, tuple(each.name for each in event.deleted_parameters))
        for changed in self._callbacks:
            changed(change)

    def _call(
        self, service: str, request: Any, timeout_s: float, cancel: threading.Event | None
    ) -> Any:
        return self._services[service].call(request, timeout_s, cancel, repeat_s=_REPEAT_S)


def _messages(values: Mapping[str, Settable]) -> list[Parameter]:
    return [Parameter(name=name, value=parameter_value(value)) for name, value in values.items()]
