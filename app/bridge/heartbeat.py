"""A thread that repeats the last message, so that silence means that we are gone."""

import contextlib
import os
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from app.bridge.errors import BridgeError
from app.geometry import NS_PER_S

Message = TypeVar("Message")

_LONGEST_SLEEP_NS = 10_000_000
"""What `close` waits for at most; a longer rest is spent where closing ends it."""

_MOST_LATE_NS = 10_000_000
"""Beats that are later than this say nothing that the one in time does not say."""


class Heartbeat(Generic[Message]):
    """Sends the newest message at once, and again at every beat of an absolute clock.

    ``send(message, seq)`` is never entered by two threads, and ``seq`` counts its calls without a
    gap. A beat that is late is sent late and moves none of those after it; one that is 10 ms late
    or more, and has another in its time, is left out and counted in `missed`. ``hz`` None: no
    thread, no beats, for a replay that does not follow real time. An error in the thread ends it,
    and is raised by the next `newest` or by `close`.
    """

    def __init__(self, send: Callable[[Message, int], None], hz: float | None) -> None:
        if hz is not None and not 0.0 < hz <= 1000.0:
            raise BridgeError(f"heartbeat rate {hz} is not within 0 (excluded) and 1000 Hz")
        self._send = send
        self._lock = threading.Lock()
        self._message: Message | None = None
        self._afterwards: Message | None = None
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

    def newest(
        self,
        message: Message,
        *,
        lasts_ns: int | None = None,
        afterwards: Message | None = None,
        unless_ended: bool = False,
    ) -> int | None:
        """Send ``message`` now, and at every beat until the next one comes; its first ``seq``.

        With ``lasts_ns`` it is repeated for as long only, and ``afterwards`` in its place from then
        on (nothing, when that is None). Without, it is repeated for ever. With ``unless_ended``
        nothing is sent and None is returned when the message before has `ended`.
        """
        self._raise_error()
        with self._lock:
            self._end_in_time()
            if unless_ended and self._ended:
                return None
            first = self.seq
            self._message, self._afterwards, self._ended = message, afterwards, False
            self._expires_ns = None if lasts_ns is None else time.monotonic_ns() + lasts_ns
            self._send_again()
            return first

    def rest(self, last: Message | None = None) -> None:
        """Send ``last``, when there is one, and then nothing until the next `newest`.

        It is sent also where the thread has ended in an error, which is raised afterwards.
        """
        with self._lock:
            if last is not None:
                self._end(last)
                self._send_again()
            self._message, self._expires_ns = None, None
        self._raise_error()

    @property
    def ended(self) -> bool:
        """Whether the newest message has come to its end, by its time or by `rest`.

        ``ended_seq`` is the ``seq`` from which on it was not repeated any more, the last time.
        """
        with self._lock:
            self._end_in_time()
            return self._ended

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        self._raise_error()

    def _send_again(self) -> None:
        self._end_in_time()
        if self._message is not None:
            self._send(self._message, self.seq)
            self.seq += 1

    def _end_in_time(self) -> None:
        if self._expires_ns is not None and time.monotonic_ns() >= self._expires_ns:
            self._end(self._afterwards)

    def _end(self, afterwards: Message | None) -> None:
        self._message, self._expires_ns = afterwards, None
        self._ended, self.ended_seq = True, self.seq

    def _beat(self, period_ns: int) -> None:
        ask_for_real_time()
        due_ns = time.monotonic_ns() + period_ns
        while self._wait_until(due_ns):
            try:
                with self._lock:
                    self._send_again()
            except Exception as error:  # handed over to the thread that can deal with it
                self._error = error
                return
            due_ns += period_ns
            late_ns = time.monotonic_ns() - due_ns
            if late_ns >= _MOST_LATE_NS:
                missed = late_ns // period_ns
                self.missed += missed
                due_ns += missed * period_ns

    def _wait_until(self, due_ns: int) -> bool:
        """Sleep; False when there is nothing more to wait for, because of `close`."""
        ahead_ns = due_ns - time.monotonic_ns()
        if ahead_ns > _LONGEST_SLEEP_NS:
            self._closing.wait(ahead_ns / NS_PER_S)
        elif ahead_ns > 0:
            time.sleep(ahead_ns / NS_PER_S)  # lets go of the interpreter and allocates nothing
        return not self._closing.is_set()

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise BridgeError(f"the heartbeat ended: {error}") from error


def ask_for_real_time() -> None:
    """Put this thread before all that is not real-time; where that is not allowed, go on as it is.

    Linux allows it to root, and to whom ``rtprio`` in limits.conf does. The thread sleeps for most
    of each beat, so nothing else starves.
    """
    if hasattr(os, "sched_setscheduler"):  # Linux
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
