"""Waiting with an end: a time and a way out for every call that blocks."""

import threading
import time
from collections.abc import Callable

from app.bridge.calls.errors import CallCancelledError, CallError, NotThereError
from app.bridge.node import RosNode

SLICE_S = 0.02
"""rclpy tells nobody that a server came or went: it has to be asked, this often."""

DEFAULT_TIMEOUT_S = 5.0

SENDING_ERRORS = (TypeError, ValueError, AssertionError, SystemError, RuntimeError)
"""What rclpy raises for a message that cannot be sent, and (the last) on a node that is closed."""

_SETTLE_S = 0.1
"""From when we see a server until it should see us: before that it drops its replies to us."""


class Deadline:
    """Until when a call may take: ``timeout_s`` from now, or until ``cancel`` is set."""

    def __init__(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        if not 0.0 <= timeout_s <= 1e6:
            raise CallError(f"timeout of {timeout_s} s: 0 to 1e6 s wanted")
        self.timeout_s = timeout_s
        self._cancel = cancel
        self._until = time.monotonic() + timeout_s

    @property
    def remaining_s(self) -> float:
        """0 when the time is over."""
        return max(0.0, self._until - time.monotonic())

    def check(self, what: str) -> None:
        """Raise `CallCancelledError` once ``cancel`` is set."""
        if self._cancel is not None and self._cancel.is_set():
            raise CallCancelledError(f"{what} was cancelled by the caller")


def check_may_wait(ros: RosNode, what: str) -> None:
    """Raise `CallError` where waiting could never end: on a closed node, in its own thread."""
    if ros.in_own_thread:
        raise CallError(
            f"{what} would wait in the node's own thread, which alone can take the reply: "
            "start it and take the reply in a callback"
        )
    if not ros.is_open:
        raise CallError(f"{what}: the node is closed")


def is_served(ros: RosNode, ready: Callable[[], bool]) -> bool:
    """Whether ``ready()``, asked of rclpy; False on a node that is closed, or closes meanwhile."""
    try:
        return ros.is_open and bool(ready())
    except RuntimeError:  # the node was closed this very moment
        return False


class ServerWait:
    """Waits until a server is ``ready()`` and has had the time to find us too.

    One that left and came back is waited for like a new one.
    """

    def __init__(self, ros: RosNode, ready: Callable[[], bool], what: str) -> None:
        self._ros = ros
        self._ready = ready
        self._what = what
        self._settled = False

    def wait(self, limit: Deadline, *, settle: bool = True) -> None:
        """Return once it is there; `NotThereError` when the time is over before.

        Without ``settle`` a first reply may be lost: for requests that are repeated.
        """
        check_may_wait(self._ros, self._what)
        pause = threading.Event()
        while not self._ready():
            self._settled = False
            limit.check(self._what)
            check_may_wait(self._ros, self._what)
            if limit.remaining_s == 0.0:
                raise NotThereError(f"{self._what}: nobody serves it, waited {limit.timeout_s:g} s")
            pause.wait(min(SLICE_S, limit.remaining_s))
        if settle and not self._settled:
            pause.wait(min(_SETTLE_S, limit.remaining_s))
            self._settled = True
