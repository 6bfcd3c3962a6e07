"""Deadlines, and waiting for servers and their replies."""

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from app.bridge.node import RosNode
from app.bridge.ros_errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    ServerGoneError,
    ServerUnavailableError,
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


class ServerWait:
    """Waits until a server is ``ready()``.

    No time is added for the server to discover this client: before it sends a reply, the server's
    middleware waits for the client's reader itself, in Fast DDS and Cyclone DDS up to 100 ms. In
    Zenoh a reply needs no discovery.
    """

    def __init__(self, ros: RosNode, ready: Callable[[], bool], what: str) -> None:
        self._ros = ros
        self._ready = ready
        self._what = what

    def wait(self, deadline: Deadline) -> None:
        """Wait for the server; raises `ServerUnavailableError` at the deadline."""
        check_can_wait(self._ros, self._what)
        pause = threading.Event()
        pause_s = _FIRST_POLL_S
        while not self._ready():
            deadline.check(self._what)
            check_can_wait(self._ros, self._what)
            if deadline.remaining_s == 0.0:
                raise ServerUnavailableError(
                    f"{self._what}: no server found within {deadline.timeout_s:g} s"
                )
            pause.wait(min(pause_s, deadline.remaining_s))
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
