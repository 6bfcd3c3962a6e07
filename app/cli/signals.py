"""What SIGINT and SIGTERM do to a command.

Where it makes something they raise, and what is half-written is taken away (`raise_signals`).

Where it takes steps they are only noted, and ask it to stop (`note_signals`). An exception at any
moment is not safe there: raised while a function that numba compiled is at work, it ends the
process with a segmentation fault now and then (measured: 4 of 14 replays; none of 2389 signals that
were only noted), and in the middle of a step it would leave half of it published.

While libraries are loaded an exception may be lost: trimesh takes whatever is raised then for a
package that is missing. So a command that runs until a signal loads them while signals are noted.
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

_LATER_S = 0.05
"""When a signal comes again that found a library being loaded."""


@dataclass(slots=True)
class SignalState:
    """The signal that came, None so far, and what is to be stopped by it."""

    number: int | None = None
    _stop: Callable[[], None] | None = None
    _ends_at_once: bool = False

    def stops(self, stop: Callable[[], None]) -> None:
        """Call ``stop`` when a signal comes; at once when one has come already."""
        self._stop = stop
        if self.number is not None:
            stop()

    @contextmanager
    def ends_at_once(self) -> Iterator[None]:
        """Within it a signal ends the process at once, one that has come already too.

        For what takes long, cannot be stopped and leaves nothing behind, such as compiling.
        """
        self._ends_at_once = True
        if self.number is not None:
            os._exit(self.exit_status)
        try:
            yield
        finally:
            self._ends_at_once = False

    def take(self, number: int) -> None:
        """Note a signal, and stop what there is to stop; a second one ends the process at once."""
        if self.number is not None or self._ends_at_once:
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
def raise_signals() -> Iterator[None]:
    """Within it SIGINT raises `KeyboardInterrupt`, SIGTERM `Terminated`: not what is ignored.

    So what is half-written is taken away again on the way out. While a library is loaded, which
    could lose what is raised, they wait. For the main thread only.
    """
    usual = (signal.SIG_DFL, signal.default_int_handler)
    before = {n: handler for n in SIGNALS if (handler := signal.getsignal(n)) in usual}
    for number in before:
        signal.signal(number, _raise)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def note_signals() -> Iterator[SignalState]:
    """Within it SIGINT and SIGTERM are noted, and stop what `SignalState.stops` was told.

    That is called in a thread of its own, so it may take locks. For the main thread only. The
    handlers that were there come back afterwards.
    """
    received = SignalState()
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


def _raise(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            again = threading.Timer(_LATER_S, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


def _only_noted(number: int, frame: FrameType | None) -> None:
    """The interpreter has written the number to the watching thread already."""
