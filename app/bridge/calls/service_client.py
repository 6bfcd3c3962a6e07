"""Service client whose calls always end, with a reply or an error, and what it waits with."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.task import Future

from app.bridge.convert.plain import from_plain, service_type
from app.bridge.node import RosNode
from app.bridge.ros_errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    ServerGoneError,
    ServerUnavailableError,
    reason_of,
)

POLL_INTERVAL_S = 0.02
"""rclpy has no event for a server that appears or leaves, so it is polled."""

DEFAULT_TIMEOUT_S = 5.0

SENDING_ERRORS = (TypeError, ValueError, AssertionError, SystemError, RuntimeError)
"""Raised by rclpy for a message that cannot be sent and (the last one) on a closed node."""

_FIRST_POLL_S = 0.0005
"""First pause of a wait for a server; each further one is twice as long, up to the interval."""

_GONE_AFTER_POLLS = 25
"""Consecutive polls without a server (0.5 s) after which it counts as gone. Its last reply may
still be in transit, and a busy machine delivers it late."""


class Deadline:
    """End of a call: ``timeout_s`` from now, or as soon as ``cancel`` is set."""

    def __init__(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        if not 0.0 <= timeout_s <= 1e6:
            raise CallError(f"timeout is {timeout_s} s; expected 0 to 1e6 s")
        self.timeout_s = timeout_s
        self._cancel = cancel
        self._end_s = time.monotonic() + timeout_s

    @property
    def remaining_s(self) -> float:
        """Remaining time; 0 after the deadline."""
        return max(0.0, self._end_s - time.monotonic())

    def check(self, what: str) -> None:
        """Raise `CallCancelledError` once ``cancel`` is set."""
        if self._cancel is not None and self._cancel.is_set():
            raise CallCancelledError(f"{what} was cancelled by the caller")


def check_can_wait(ros: RosNode, what: str) -> None:
    """Raise `CallError` where a wait would never end: closed node, or the node's own thread."""
    if ros.in_own_thread:
        raise CallError(
            f"{what} would block the node's thread, which has to receive the reply; "
            "use `start` and a callback"
        )
    if not ros.is_open:
        raise CallError(f"{what}: the node is closed")


def is_served(ros: RosNode, ready: Callable[[], bool]) -> bool:
    """Result of rclpy's ``ready()``; False on a node that is closed or closing."""
    try:
        return ros.is_open and bool(ready())
    except RuntimeError:  # the node was closed concurrently
        return False


def wait_for_server(ros: RosNode, ready: Callable[[], bool], what: str, deadline: Deadline) -> None:
    """Wait until a server is ``ready()``; raises `ServerUnavailableError` at the deadline.

    No time is added for the server to discover this client: before it sends a reply, the server's
    middleware waits for the client's reader itself, in Fast DDS and Cyclone DDS up to 100 ms. In
    Zenoh a reply needs no discovery.
    """
    check_can_wait(ros, what)
    pause_s = _FIRST_POLL_S
    while not ready():
        deadline.check(what)
        check_can_wait(ros, what)
        if deadline.remaining_s == 0.0:
            raise ServerUnavailableError(f"{what}: no server found within {deadline.timeout_s:g} s")
        time.sleep(min(pause_s, deadline.remaining_s))
        pause_s = min(2.0 * pause_s, POLL_INTERVAL_S)


class PendingReply:
    """Future of a reply, returned by a client's ``start``. Created by clients only.

    ``is_available()`` is true while the server is discovered. ``abandon()`` is called on `cancel`.
    """

    def __init__(
        self,
        ros: RosNode,
        future: Future,
        what: str,
        *,
        is_available: Callable[[], bool],
        abandon: Callable[[], None],
    ) -> None:
        self._ros = ros
        self._future = future
        self._what = what
        self._is_available = is_available
        self._abandon = abandon
        self._cancelled = False
        self._arrived = threading.Event()
        future.add_done_callback(lambda _: self._arrived.set())

    @property
    def is_done(self) -> bool:
        """True if `result` returns at once."""
        return bool(self._future.done())

    def when_done(self, callback: Callable[[Any], None]) -> None:
        """Call ``callback(reply)`` in the node's thread; never called after `cancel`."""

        def on_reply(future: Future) -> None:
            if not self._cancelled:
                callback(future.result())

        self._future.add_done_callback(on_reply)

    def result(self, timeout_s: float, cancel: threading.Event | None = None) -> Any:
        """Wait for the reply and return it.

        Raises `CallTimeoutError` (`result` may be called again), `ServerGoneError` when the server
        has left the graph, `CallCancelledError`.
        """
        deadline = Deadline(timeout_s, cancel)
        if not self._future.done():
            check_can_wait(self._ros, self._what)
        polls_without_server = 0
        while not self._future.done():
            if self._cancelled:
                raise CallCancelledError(f"{self._what} was cancelled by the caller")
            deadline.check(self._what)
            if not self._ros.is_open:
                raise CallError(f"{self._what}: the node was closed before the reply arrived")
            polls_without_server = 0 if self._is_available() else polls_without_server + 1
            if polls_without_server >= _GONE_AFTER_POLLS:
                raise ServerGoneError(f"{self._what}: the server left before it replied")
            if deadline.remaining_s == 0.0:
                raise CallTimeoutError(f"{self._what}: no reply within {timeout_s:g} s")
            self._arrived.wait(min(POLL_INTERVAL_S, deadline.remaining_s))
        return self._future.result()

    def cancel(self) -> None:
        """Discard the reply; a pending `result` raises `CallCancelledError`."""
        if not self._future.done():
            self._cancelled = True
            self._arrived.set()
            self._abandon()


_MAX_OPEN = 1000
_MAX_ABANDONED = 100
_MAX_REPLIES = 1000
"""Replies that wait for the node's thread. Replies to other clients count, because each client
receives all of them: with ROS's default of 10 a burst of another client would drop our reply."""


class ServiceClient:
    """``ServiceClient(ros, "std_srvs/srv/Trigger", "/robot/home").call(Trigger.Request())``.

    A reply that arrives after the caller's timeout is logged, for the newest 100 abandoned calls.
    """

    def __init__(self, ros: RosNode, service: str | type, name: str) -> None:
        self.type = service_type(service)
        self._ros = ros
        try:
            qos = QoSProfile(depth=_MAX_REPLIES)  # reliable and volatile, as ROS's default
            self._client = ros.node.create_client(self.type, name, qos_profile=qos)
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no client for a service {name!r}: {reason_of(error)}") from error
        self.name = str(self._client.service_name)
        self._closed = False
        self._lock = threading.Lock()
        self._open: set[Future] = set()
        self._abandoned: deque[Future] = deque()

    @property
    def is_available(self) -> bool:
        """True if a server of the service is discovered."""
        with self._lock:
            return not self._closed and is_served(self._ros, self._client.service_is_ready)

    def wait(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        """Wait for a server; raises `ServerUnavailableError`."""
        self._wait(Deadline(timeout_s, cancel))

    def call(
        self,
        request: Any,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
        *,
        repeat_s: float = math.inf,
    ) -> Any:
        """Send ``request`` and return the reply; ``timeout_s`` includes finding the server.

        Setting ``cancel`` from another thread ends the wait. An idempotent request can be repeated
        every ``repeat_s``: a server whose middleware has not discovered this client in time
        (Fast DDS: 100 ms) drops its reply, so a request that is sent once can time out. Raises
        `ServerUnavailableError`, `ServerGoneError`, `CallTimeoutError`, `CallCancelledError`.
        """
        deadline = Deadline(timeout_s, cancel)
        self._wait(deadline)
        while True:
            pending = self.start(request)
            try:
                return pending.result(min(deadline.remaining_s, repeat_s), cancel)
            except CallTimeoutError:
                if deadline.remaining_s == 0.0:
                    what = f"service {self.name}: no reply within {timeout_s:g} s"
                    raise CallTimeoutError(what) from None
            finally:
                pending.cancel()  # does nothing when the reply has arrived

    def start(self, request: Any) -> PendingReply:
        """Send ``request`` and return at once, without waiting for a server.

        The request is a ROS message (lengths in m) or a mapping of plain values (lengths in mm).
        The reply is a ROS message; `app.bridge.convert.to_plain` converts it. Raises `CallError`,
        and `ConversionError` for a value that does not fit its field.
        """
        if isinstance(request, Mapping):
            request = from_plain(self.type.Request, request)
        if not isinstance(request, self.type.Request):
            raise CallError(
                f"{self.name}: the request is a {type(request).__name__}; "
                f"expected {self.type.__name__}.Request or a mapping"
            )
        with self._lock:
            if len(self._open) >= _MAX_OPEN:
                raise CallError(f"{self.name}: {_MAX_OPEN} calls are already waiting for a reply")
            if self._closed or not self._ros.is_open:
                what = "client" if self._closed else "node"
                raise CallError(f"service {self.name}: the {what} is closed")
            try:
                future = self._client.call_async(request)
            except SENDING_ERRORS as error:
                reason = reason_of(error)
                raise CallError(f"{self.name}: the request cannot be sent: {reason}") from error
            self._open.add(future)
        future.add_done_callback(self._on_reply)
        return PendingReply(
            self._ros,
            future,
            f"service {self.name}",
            is_available=lambda: self.is_available,
            abandon=lambda: self._abandon(future),
        )

    def close(self) -> None:
        """Destroy the client; pending calls end with `ServerGoneError`."""
        with self._lock:
            if self._ros.is_open and not self._closed:
                self._ros.node.destroy_client(self._client)
            self._closed = True

    def _wait(self, deadline: Deadline) -> None:
        what = f"service {self.name}"
        wait_for_server(self._ros, lambda: self.is_available, what, deadline)

    def _on_reply(self, future: Future) -> None:
        with self._lock:
            self._open.discard(future)
            late = future in self._abandoned
            if late:
                self._abandoned.remove(future)
        if late:
            self._ros.node.get_logger().warning(
                f"service {self.name}: a reply arrived after the caller's timeout",
                throttle_duration_sec=1.0,
            )

    def _abandon(self, future: Future) -> None:
        with self._lock:
            if future not in self._open:
                return
            self._open.discard(future)
            self._abandoned.append(future)
            if len(self._abandoned) <= _MAX_ABANDONED:
                return
            oldest = self._abandoned.popleft()
        self._client.remove_pending_request(oldest)
