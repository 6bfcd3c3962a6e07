"""Call a function in the thread of Qt's event loop when data arrive in another thread."""

from collections.abc import Callable
from typing import Any

from app.runtime.wakeup import Wakeup

WATCHDOG_MS = 100
"""Time without a call after which ``spin`` is called: a silent source must become stale."""

_WAIT_S = 0.005
"""Longest wait in one turn of the event loop: the user's input waits as long."""


class QtSpinner:
    """Calls ``spin()`` after `wake`, once for many calls, and after ``watchdog_ms`` without one.

    Create and use it in the thread of Qt's event loop; `wake` may be called in any thread, also
    after `stop`. An exception of ``spin`` is left to the binding, which logs it; later calls
    follow. A ``spin`` that runs the event loop itself is not called again before it has returned.

    ``qt`` has ``QTimer`` and ``QSocketNotifier``. Most bindings release Python's interpreter lock
    while Qt waits for events; then a `QSocketNotifier` wakes the event loop. PythonQt, the binding
    of desktop Slicer, keeps the lock: no other thread could run, receive data and call `wake`. Then
    a timer without interval, which Qt serves when no event is pending, waits for `wake` in Python,
    which releases the lock. ``keeps_lock`` says which it is; by default the binding decides.
    """

    def __init__(
        self,
        qt: Any,
        spin: Callable[[], object],
        *,
        keeps_lock: bool | None = None,
        watchdog_ms: int = WATCHDOG_MS,
    ) -> None:
        self._spin = spin
        self._is_stopped = False
        self._is_spinning = False
        self._is_missed = False
        self._wakeup = Wakeup()
        self._watchdog = _timer(qt, watchdog_ms, self._call)
        self._waiting: Any = None
        self._notifier: Any = None
        if keeps_interpreter_lock(qt) if keeps_lock is None else keeps_lock:
            self._waiting = _timer(qt, 0, self._wait)
        else:
            self._notifier = qt.QSocketNotifier(self._wakeup.fileno(), qt.QSocketNotifier.Read)
            self._notifier.activated.connect(self._activated)

    def wake(self) -> None:
        """Call ``spin()`` soon."""
        self._wakeup.wake()

    def stop(self) -> None:
        """Call ``spin()`` no more, and release all resources. Idempotent."""
        self._is_stopped = True
        self._watchdog.stop()
        if self._waiting is not None:
            self._waiting.stop()
        if self._notifier is not None:
            self._notifier.setEnabled(False)  # Qt must not watch a closed descriptor
        self._wakeup.close()

    def _activated(self, *_: Any) -> None:
        self._call()

    def _wait(self) -> None:
        if self._wakeup.wait(_WAIT_S):
            self._call()

    def _call(self) -> None:
        self._wakeup.clear()
        if self._is_spinning:
            self._is_missed = True
            return
        self._is_spinning = True
        try:
            self._spin()
        finally:
            self._is_spinning = False
            if self._is_missed:
                self._is_missed = False
                self.wake()
            if not self._is_stopped:
                self._watchdog.start()  # anew


def keeps_interpreter_lock(qt: Any) -> bool:
    """True unless the binding is known to release Python's lock while Qt waits for events."""
    return not str(qt.QTimer.__module__).startswith(("PySide", "PyQt"))


def _timer(qt: Any, interval_ms: int, slot: Callable[[], None]) -> Any:
    timer = qt.QTimer()
    timer.setInterval(interval_ms)
    timer.timeout.connect(slot)
    timer.start()
    return timer
