"""Event loops of Qt: one that releases Python's lock as PySide6's, one that keeps it as PythonQt's.

In desktop Slicer the binding is PythonQt, which cannot be installed elsewhere.
"""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import PySide6
from PySide6 import QtCore

from benchmarks.latency.receivers import KEPT, RELEASED

DEADLINE_MS = 20_000  # ends a loop that waits for something that does not come


def run_releasing(stop_after_ms: int = DEADLINE_MS) -> None:
    """Run PySide6's event loop, during which other threads run, until `quit_loop`."""
    with _deadline(stop_after_ms):
        QtCore.QCoreApplication.exec()


def run_keeping(stop_after_ms: int = DEADLINE_MS) -> None:
    """Run the same loop with the interpreter lock kept, until `quit_loop`: TEST DOUBLE of PythonQt.

    Functions of a `ctypes.PyDLL` are called without a release of the lock, as PythonQt calls Qt.
    """
    library = next((Path(PySide6.__file__).parent / "Qt" / "lib").glob("libQt6Core.so*"))
    with _deadline(stop_after_ms):
        ctypes.PyDLL(str(library))["_ZN16QCoreApplication4execEv"]()


@contextmanager
def _deadline(stop_after_ms: int) -> Iterator[None]:
    """End the loop after ``stop_after_ms``, but no loop that follows it."""
    timer = QtCore.QTimer()
    timer.setSingleShot(True)
    timer.timeout.connect(quit_loop)
    timer.start(stop_after_ms)
    yield
    timer.stop()


def quit_loop() -> None:
    QtCore.QCoreApplication.exit(0)


LOOPS: dict[str, tuple[Callable[..., None], bool]] = {
    RELEASED: (run_releasing, False),
    KEPT: (run_keeping, True),
}
"""By name: the loop, and whether it keeps the interpreter lock."""
