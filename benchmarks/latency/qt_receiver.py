"""Base of the receivers in Qt's event loop: woken by messages, or by a timer as before."""

import os
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6 import QtCore, QtWidgets

from app.runtime import QtSpinner
from benchmarks.latency.qt_loops import LOOPS, quit_loop
from benchmarks.latency.receivers import Receiver

_POLL_MS = 100
_LONGEST_MS = 3_600_000


@dataclass(frozen=True, slots=True)
class Waking:
    """How Qt's thread learns of a message: ``timer_ms`` None is the product's `QtSpinner`.

    ``loop`` is one of `LOOPS`.
    """

    loop: str
    timer_ms: int | None = None


class QtReceiver(Receiver):
    """Calls `spin` in Qt's event loop; ``wake`` may be called in any thread."""

    def __init__(self, waking: Waking) -> None:
        super().__init__()
        # A process has one application, and a module's widgets need this class.
        self._application = QtWidgets.QApplication.instance() or QtWidgets.QApplication([])
        self._run_loop, keeps_lock = LOOPS[waking.loop]
        self._driver: Any
        if waking.timer_ms is None:
            self._driver = QtSpinner(QtCore, self.spin, keeps_lock=keeps_lock)
            self.wake: Callable[[], None] = self._driver.wake
        else:
            self._driver = QtCore.QTimer()
            self._driver.timeout.connect(self.spin)
            self._driver.start(waking.timer_ms)
            self.wake = _nothing

    @abstractmethod
    def spin(self) -> None:
        """Update the scene."""

    def run(self, has_ended: Callable[[], bool]) -> None:
        """Run the event loop."""
        poll = QtCore.QTimer()
        poll.timeout.connect(lambda: quit_loop() if has_ended() else None)
        poll.start(_POLL_MS)
        self._run_loop(_LONGEST_MS)
        poll.stop()

    def close(self) -> None:
        """Spin no more."""
        self._driver.stop()


def _nothing() -> None:
    """A timer is not woken."""
