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
from app.bridge.ros_errors import (
    BridgeError,
    CallError,
    ConversionError,
    ParameterUnsetError,
    RefusedError,
)
from app.bridge.topics import Topic

_EVENTS = Topic("/parameter_events", ParameterEvent, qos_profile_parameter_events)
_REPEAT_S = 1.0
"""Parameter requests are idempotent and can be repeated."""

_POLL_S = 0.2
_CLOSE_TIMEOUT_S = 5.0
_MAX_PARAMETERS = 10_000
"""Most parameters of one node; changes of further ones are ignored."""

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


class ParameterWatch:
    """`add` a name, then `take` new values; the value is None for a parameter that is not set.

    All names are requested again when the node returns after it was gone. Changes of the node's
    other parameters are returned as well. ``changed()`` is called in another thread when there are
    new values.
    """

    def __init__(self, ros: RosNode, node: str, changed: Callable[[], None]) -> None:
        self._ros = ros
        self._changed = changed
        self._client = ParameterClient(ros, node)
        self._condition = threading.Condition()
        self._names: set[str] = set()
        self._unanswered: set[str] = set()
        self._change_counts: dict[str, int] = {}
        self._new: dict[str, Plain | None] = {}
        self._closing = threading.Event()
        self.node = self._client.node
        self._client.watch(self._take_change)
        self._thread = threading.Thread(target=self._run, name=f"parameters of {node}", daemon=True)
        self._thread.start()

    @property
    def is_available(self) -> bool:
        """True while the node serves its parameters."""
        return self._client.is_available

    def add(self, name: str) -> None:
        """Request the value of ``name``."""
        with self._condition:
            self._names.add(name)
            self._unanswered.add(name)
            self._condition.notify()

    def remove(self, name: str) -> None:
        """Stop requesting ``name``."""
        with self._condition:
            self._names.discard(name)
            self._unanswered.discard(name)

    def take(self) -> dict[str, Plain | None]:
        """New values since the last call."""
        with self._condition:
            new, self._new = self._new, {}
        return new

    def close(self) -> None:
        """Stop the thread and leave the graph."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        self._thread.join(_CLOSE_TIMEOUT_S)
        self._ros.call(self._client.close)

    def _take_change(self, change: ParameterChange) -> None:
        for name, value in {**change.values, **dict.fromkeys(change.deleted)}.items():
            with self._condition:
                if name in self._change_counts or len(self._change_counts) < _MAX_PARAMETERS:
                    self._change_counts[name] = self._change_counts.get(name, 0) + 1
                    self._new[name] = value
        self._changed()

    def _run(self) -> None:
        was_available = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._unanswered and was_available) and not self._closing.is_set():
                    self._condition.wait(_POLL_S)
                requested = set(self._unanswered)
            is_available = self._client.is_available
            if is_available and not was_available:
                with self._condition:
                    requested = set(self._names)
            was_available = is_available and self._get(requested)

    def _get(self, names: set[str]) -> bool:
        """Request ``names``; False if the node did not answer."""
        for name in names:
            with self._condition:
                count = self._change_counts.get(name, 0)
            value: Plain | None = None
            try:
                value = self._client.get(name, DEFAULT_TIMEOUT_S, self._closing)
            except ParameterUnsetError:
                value = None
            except BridgeError:  # gone, no reply, invalid value or closing: requested again
                return False
            with self._condition:
                self._unanswered.discard(name)
                # A change received in the meantime is newer than the answer.
                if name in self._names and self._change_counts.get(name, 0) == count:
                    self._new[name] = value
            self._changed()
        return True
