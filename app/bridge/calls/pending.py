"""A reply that is under way."""

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
from app.bridge.calls.waiting import SLICE_S, Deadline, check_may_wait
from app.bridge.node import RosNode

_GONE_AFTER = 25
"""So many looks in a row without a server, half a second: its last reply may still be on the way,
and a busy machine hands it over late."""


class Pending:
    """What `start` of a client gives back; made by clients alone.

    ``there()`` says whether a server still is; ``abandon()`` is called when the reply is not
    wanted any more.
    """

    def __init__(
        self,
        ros: RosNode,
        future: Future,
        what: str,
        *,
        there: Callable[[], bool],
        abandon: Callable[[], None],
    ) -> None:
        self._ros = ros
        self._future = future
        self._what = what
        self._there = there
        self._abandon = abandon
        self._cancelled = False
        self._arrived = threading.Event()
        future.add_done_callback(lambda _: self._arrived.set())

    @property
    def is_done(self) -> bool:
        """Whether `result` returns at once."""
        return bool(self._future.done())

    def when_done(self, take: Callable[[Any], None]) -> None:
        """Call ``take(reply)`` in the node's thread; never called after `cancel`."""

        def arrived(future: Future) -> None:
            if not self._cancelled:
                take(future.result())

        self._future.add_done_callback(arrived)

    def result(self, timeout_s: float, cancel: threading.Event | None = None) -> Any:
        """The reply.

        Raises `CallTimeoutError` when it has not come in time (it may be asked for again),
        `ServerGoneError` when who had to send it has left, `CallCancelledError`.
        """
        limit = Deadline(timeout_s, cancel)
        if not self._future.done():
            check_may_wait(self._ros, self._what)
        missing = 0
        while not self._future.done():
            if self._cancelled:
                raise CallCancelledError(f"{self._what} was cancelled by the caller")
            limit.check(self._what)
            if not self._ros.is_open:
                raise CallError(f"{self._what}: the node was closed before the reply came")
            missing = 0 if self._there() else missing + 1
            if missing >= _GONE_AFTER:
                raise ServerGoneError(f"{self._what}: the server left before it replied")
            if limit.remaining_s == 0.0:
                raise CallTimeoutError(f"{self._what}: no reply within {timeout_s:g} s")
            self._arrived.wait(min(SLICE_S, limit.remaining_s))
        return self._future.result()

    def cancel(self) -> None:
        """The reply is not wanted; whoever waits in `result` gets `CallCancelledError`."""
        if not self._future.done():
            self._cancelled = True
            self._arrived.set()
            self._abandon()
