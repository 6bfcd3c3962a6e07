"""A reply that has been requested and may not have arrived yet."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from app.bridge.calls.errors import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    ServerGoneError,
)
from app.bridge.calls.waiting import POLL_INTERVAL_S, Deadline, check_can_wait
from app.bridge.node import RosNode

_GONE_AFTER_POLLS = 25
"""Consecutive polls without a server (0.5 s) after which it counts as gone. Its last reply may
still be in transit, and a busy machine delivers it late."""


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
