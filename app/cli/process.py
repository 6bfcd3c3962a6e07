"""Control of the process that runs a command.

A command that writes files lets them raise, so that half-written files are removed
(`raise_signals`).

A command that takes steps only records them and calls a stop function (`note_signals`). An
exception at any time is not safe there. Raised inside a function that numba compiled, it sometimes
ends the process with a segmentation fault (measured: 4 of 14 replays; none of 2389 signals that
were only recorded). Raised during a step, it leaves the step published in part.

An exception during an import may be lost: trimesh takes any exception for a missing package. A
command that runs until a signal therefore imports its libraries while signals are recorded.
"""

import atexit
import gc
import inspect
import os
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import NoReturn, Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)

_LATER_S = 0.05
"""Delay after which a signal that arrived during an import is sent again."""


@dataclass(slots=True)
class SignalState:
    """The signal that was received, None before, and the function that it calls."""

    number: int | None = None
    _stop: Callable[[], None] | None = None
    _ends_at_once: bool = False

    def stops(self, stop: Callable[[], None]) -> None:
        """Call ``stop`` when a signal arrives; at once if one has arrived already."""
        self._stop = stop
        if self.number is not None:
            stop()

    @contextmanager
    def ends_at_once(self) -> Iterator[None]:
        """Within the context a signal ends the process at once, also one received before.

        For long work that cannot be stopped and writes nothing, such as compiling.
        """
        self._ends_at_once = True
        if self.number is not None:
            os._exit(self.exit_status)
        try:
            yield
        finally:
            self._ends_at_once = False

    def take(self, number: int) -> None:
        """Record a signal and call the stop function; a second one ends the process at once."""
        if self.number is not None or self._ends_at_once:
            os._exit(128 + number)
        self.number = number
        if self._stop is not None:
            self._stop()

    @property
    def exit_status(self) -> int:
        """Exit status that shells expect: 128 plus the number of the signal; 0 without one."""
        return 0 if self.number is None else 128 + self.number


class Terminated(KeyboardInterrupt):
    """Raised for SIGTERM, as KeyboardInterrupt is for SIGINT."""


@contextmanager
def raise_signals() -> Iterator[None]:
    """Within the context SIGINT raises `KeyboardInterrupt` and SIGTERM `Terminated`.

    Ignored signals stay ignored. During an import, which could lose an exception, and while a
    temporary folder is made, which nothing would remove, a signal is delayed. For the main thread
    only.
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
    """Within the context SIGINT and SIGTERM are recorded and call the stop function.

    The stop function runs in a thread of its own, so it may take locks. For the main thread only.
    The previous handlers are restored afterwards.
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
    handlers = {number: signal.signal(number, _only_recorded) for number in SIGNALS}
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


_MAKES_FOLDER = tempfile.TemporaryDirectory.__init__.__code__


def _raise(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        code = frame.f_code
        if code is _MAKES_FOLDER or code.co_filename == "<frozen importlib._bootstrap>":
            again = threading.Timer(_LATER_S, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


def _only_recorded(number: int, frame: FrameType | None) -> None:
    """Do nothing: the interpreter has written the number to the watching thread already."""


def leave(status: int) -> NoReturn:
    """End this process as `multiprocessing` ends one: with threads and functions of `atexit`.

    What is loaded is not freed, which takes up to half a second. The teardown of native libraries
    has crashed after all was done, and Python aborts where a thread waits for standard input.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # None, without a reader, or closed
            stream.flush()
    os._exit(status)


NEW_OBJECTS = 50_000
"""New objects between two collections. Each block of frames that is read ahead
(`app.case.frame_streams.read_ahead`) allocates a thousand and soon frees them."""


class GcPause:
    """Within the context collection is off until `settle`, and then covers newer objects only.

    Loading allocates a million objects, nearly all of which stay until the end of the process.
    """

    def __enter__(self) -> Self:
        self._enabled, self._thresholds = gc.isenabled(), gc.get_threshold()
        gc.disable()
        return self

    def settle(self) -> None:
        """Freeze all present objects for good; call it when all is loaded."""
        gc.freeze()
        gc.set_threshold(NEW_OBJECTS, *self._thresholds[1:])
        self._restore_enabled()

    def __exit__(self, *_: object) -> None:
        gc.set_threshold(*self._thresholds)
        self._restore_enabled()

    def _restore_enabled(self) -> None:
        if self._enabled:
            gc.enable()


@contextmanager
def prompt_process() -> Iterator[None]:
    """Within the context no thread waits long for another one, and collections are short.

    A full garbage collection of what a command loads takes about half a second, in which no thread
    runs: it is done here, and those objects are frozen for good. So enter it when all is loaded,
    and before anything is received. A computing thread keeps the interpreter lock for
    `SWITCH_INTERVAL_S` at most instead of 5 ms. rclpy finds the caller of a log message by
    `inspect`, which looks at the files of all modules once, for 0.1 s: here.
    """
    from app.runtime import SWITCH_INTERVAL_S  # slow to load, for a child that does not need it

    inspect.getmodule(inspect.currentframe())
    switch_s = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(min(switch_s, SWITCH_INTERVAL_S))
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
