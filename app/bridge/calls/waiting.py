"""Deadlines and waiting for servers."""

import threading
import time
from collections.abc import Callable

from app.bridge.calls.errors import CallCancelledError, CallError, ServerUnavailableError
from app.bridge.node import RosNode

POLL_INTERVAL_S = 0.02
"""rclpy has no event for a server that appears or leaves, so it is polled."""

DEFAULT_TIMEOUT_S = 5.0

SENDING_ERRORS = (TypeError, ValueError, AssertionError, SystemError, RuntimeError)
"""Raised by rclpy for a message that cannot be sent and (the last one) on a closed node."""

_FIRST_POLL_S = 0.0005
"""First pause of a wait for a server; each further one is twice as long, up to the interval."""


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
