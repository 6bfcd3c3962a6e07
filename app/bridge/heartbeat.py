"""Clock of this host for validities, and a thread that repeats the latest message at its rate."""

import contextlib
import os
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from app.bridge.ros_errors import BridgeError
from app.geometry import NS_PER_S

Message = TypeVar("Message")

_MAX_SLEEP_NS = 10_000_000
"""Longest uninterruptible sleep, which bounds the time that `close` takes."""

_MAX_LATE_NS = 10_000_000
"""Beats that are later than this are skipped."""


def steady_ns() -> int:
    """Time in ns since the machine was started, including the time for which it was suspended.

    `time.monotonic_ns` stands still while a machine sleeps: data would stay valid for that long.
    """
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class Heartbeat(Generic[Message]):
    """Sends the newest message at once and repeats it at ``hz``.

    ``send(message, seq)`` is called by one thread at a time; ``seq`` counts its calls without a
    gap, each from its begin. Beats are due at multiples of the period, so a late beat does not
    delay the next ones. A beat that is 10 ms late or more, with the next one already due, is
    skipped and counted in `missed`. ``hz`` None repeats nothing and starts no thread, for replays
    that do not run in real time. An error in the thread ends it and is raised by the next `update`
    or by `close`.
    """

    def __init__(self, send: Callable[[Message, int], None], hz: float | None) -> None:
        if hz is not None and not 0.0 < hz <= 1000.0:
            raise BridgeError(
                f"heartbeat rate is {hz} Hz; expected more than 0 and at most 1000 Hz"
            )
        self._send = send
        self._lock = threading.Lock()
        self._message: Message | None = None
        self._replacement: Callable[[], Message] | None = None
        self._expires_ns: int | None = None
        self._ended = False
        self._error: Exception | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.seq = 0
        self.missed = 0
        self.ended_seq = 0
        if hz is not None:
            period_ns = round(NS_PER_S / hz)
            self._thread = threading.Thread(
                target=self._beat, args=(period_ns,), name="heartbeat", daemon=True
            )
            self._thread.start()

    def update(
        self,
        message: Message,
        *,
        valid_ns: int | None = None,
        since_ns: int | None = None,
        replacement: Callable[[], Message] | None = None,
        unless_ended: bool = False,
    ) -> int | None:
        """Send ``message`` now and at every beat until the next call; returns its first ``seq``.

        ``valid_ns`` after ``since_ns`` (of `steady_ns`, the present by default) it is replaced by
        the result of ``replacement()``, called then in any thread, or by nothing if that is None:
        the replacement alone is sent if that time has passed. Without ``valid_ns`` it is repeated
        indefinitely. With ``unless_ended`` nothing is sent and None is returned if the previous
        message has `ended`.
        """
        self._raise_error()
        with self._lock:
            self._check_expiry()
            if unless_ended and self._ended:
                return None
            first = self.seq
            self._message, self._replacement, self._ended = message, replacement, False
            begin_ns = steady_ns() if since_ns is None else since_ns
            self._expires_ns = None if valid_ns is None else begin_ns + valid_ns
            self._send_current()
            return first

    def pause(self, last: Message | None = None) -> None:
        """Send ``last``, if given, then send nothing until the next `update`.

        ``last`` is sent even if the thread has ended with an error, which is raised afterwards.
        """
        with self._lock:
            if last is not None:
                self._end(last)
                self._send_current()
            self._message, self._expires_ns = None, None
        self._raise_error()

    @property
    def ended(self) -> bool:
        """True if the newest message has expired or `pause` was called.

        ``ended_seq`` is the first ``seq`` after the latest such end.
        """
        with self._lock:
            self._check_expiry()
            return self._ended

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        self._raise_error()

    def _send_current(self) -> None:
        self._check_expiry()
        if self._message is not None:
            # Counted first: a receiver may answer before the send returns.
            seq, self.seq = self.seq, self.seq + 1
            self._send(self._message, seq)

    def _check_expiry(self) -> None:
        if self._expires_ns is not None and steady_ns() >= self._expires_ns:
            self._end(None if self._replacement is None else self._replacement())

    def _end(self, replacement: Message | None) -> None:
        self._message, self._expires_ns = replacement, None
        self._ended, self.ended_seq = True, self.seq

    def _beat(self, period_ns: int) -> None:
        ask_for_real_time()
        due_ns = steady_ns() + period_ns
        while self._wait_until(due_ns):
            try:
                with self._lock:
                    self._send_current()
            except Exception as error:  # raised later in the caller's thread
                self._error = error
                return
            due_ns += period_ns
            late_ns = steady_ns() - due_ns
            if late_ns >= _MAX_LATE_NS:
                missed = late_ns // period_ns
                self.missed += missed
                due_ns += missed * period_ns

    def _wait_until(self, due_ns: int) -> bool:
        """Sleep until ``due_ns``; False if `close` was called."""
        ahead_ns = due_ns - steady_ns()
        if ahead_ns > _MAX_SLEEP_NS:
            self._closing.wait(ahead_ns / NS_PER_S)
        elif ahead_ns > 0:
            time.sleep(ahead_ns / NS_PER_S)  # releases the interpreter lock, allocates nothing
        return not self._closing.is_set()

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise BridgeError(f"the heartbeat ended: {error}") from error


def ask_for_real_time() -> None:
    """Request real-time scheduling (SCHED_FIFO) for this thread; does nothing if not permitted.

    Linux permits it to root and to users with ``rtprio`` in limits.conf. The thread sleeps for
    most of each period, so it does not starve others.
    """
    if hasattr(os, "sched_setscheduler"):  # Linux
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
