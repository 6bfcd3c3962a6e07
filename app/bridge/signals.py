"""SIGTERM unwinds the program as Ctrl-C does, so that every ``with`` is left and ROS is told."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def terminate_cleanly() -> Iterator[None]:
    """Within it SIGTERM raises ``SystemExit(143)``, the shell's status for it; main thread only.

    SIGINT needs nothing: Python raises KeyboardInterrupt for it. The handler that was there comes
    back afterwards.
    """

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
