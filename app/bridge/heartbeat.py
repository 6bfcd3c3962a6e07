"""A thread that repeats the last constraint, so that silence means that we are gone."""

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from app.bridge.errors import BridgeError
from app.geometry import NS_PER_S

Message = TypeVar("Message")


class Heartbeat(Generic[Message]):
    """Sends the newest message at once, and again at every beat of an absolute clock.

    ``send(message, seq)`` is never entered by two threads, and ``seq`` counts its calls without a
    gap. A beat that is missed is left out, not made up for. ``hz`` None: no thread, no beats, for
    a replay that does not follow real time. An error in the thread ends it, and is raised by the
    next `newest` or by `close`.
    """

    def __init__(self, send: Callable[[Message, int], None], hz: float | None) -> None:
        if hz is not None and not 0.0 < hz <= 1000.0:
            raise BridgeError(f"heartbeat rate {hz} is not within 0 (excluded) and 1000 Hz")
        self._send = send
        self._lock = threading.Lock()
        self._message: Message | None = None
        self._seq = 0
        self._error: Exception | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        if hz is not None:
            period_ns = round(NS_PER_S / hz)
            self._thread = threading.Thread(
                target=self._beat, args=(period_ns,), name="heartbeat", daemon=True
            )
            self._thread.start()

    def newest(self, message: Message) -> None:
        """Send ``message`` now, and at every beat until the next one comes."""
        self._raise_error()
        with self._lock:
            self._message = message
            self._send_again()

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
        self._raise_error()

    def _send_again(self) -> None:
        if self._message is not None:
            self._send(self._message, self._seq)
            self._seq += 1

    def _beat(self, period_ns: int) -> None:
        due_ns = time.monotonic_ns() + period_ns
        while not self._closing.wait(max(0, due_ns - time.monotonic_ns()) / NS_PER_S):
            try:
                with self._lock:
                    self._send_again()
            except Exception as error:  # handed over to the thread that can deal with it
                self._error = error
                return
            late_ns = max(0, time.monotonic_ns() - due_ns)
            due_ns += (late_ns // period_ns + 1) * period_ns

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise BridgeError(f"the heartbeat ended: {error}") from error
