"""SIGINT and SIGTERM ask a replay to stop, instead of breaking into whatever it is doing.

Python's own way, an exception at any moment, is not safe here: raised while a function that numba
compiled is at work, it ends the process with a segmentation fault now and then (measured: 4 of 14
replays; none of 2389 signals that were only noted). And an exception in the middle of a step would
leave half of it published. While libraries are loaded it may be lost: trimesh takes whatever is
raised then for a package that is missing. So a command that runs until a signal loads them within.
"""

import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass(slots=True)
class Received:
    """The signal that came, None so far, and what is to be stopped by it."""

    number: int | None = None
    _stop: Callable[[], None] | None = None

    def stops(self, stop: Callable[[], None]) -> None:
        """Call ``stop`` when a signal comes; at once when one has come already."""
        self._stop = stop
        if self.number is not None:
            stop()

    def take(self, number: int) -> None:
        """Note a signal, and stop what there is to stop; a second one ends the process at once."""
        if self.number is not None:
            os._exit(128 + number)
        self.number = number
        if self._stop is not None:
            self._stop()

    @property
    def exit_status(self) -> int:
        """What a shell expects of a program that a signal ended: 128 and its number; 0 without."""
        return 0 if self.number is None else 128 + self.number


class Terminated(KeyboardInterrupt):
    """SIGTERM, raised as SIGINT is."""


@contextmanager
def raise_on_sigterm() -> Iterator[None]:
    """Within it SIGTERM raises `Terminated`, so that what is half-written is taken away again.

    For the main thread only, and where no library is being loaded, which could lose it.
    """
    before = signal.signal(signal.SIGTERM, _raise_terminated)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def note_signals() -> Iterator[Received]:
    """Within it SIGINT and SIGTERM are noted, and stop what `Received.stops` was told.

    That is called in a thread of its own, so it may take locks. For the main thread only. The
    handlers that were there come back afterwards.
    """
    received = Received()
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def watch() -> None:
        while numbers := reader.recv(1):
            if numbers[0] in SIGNALS:
                received.take(numbers[0])

    thread = threading.Thread(target=watch, name="signals", daemon=True)
    thread.start()
    handlers = {number: signal.signal(number, _only_noted) for number in SIGNALS}
    wakeup_before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    try:
        yield received
    finally:
        signal.set_wakeup_fd(wakeup_before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        writer.close()
        thread.join()
        reader.close()


def _raise_terminated(number: int, frame: FrameType | None) -> None:
    raise Terminated


def _only_noted(number: int, frame: FrameType | None) -> None:
    """The interpreter has written the number to the watching thread already."""
