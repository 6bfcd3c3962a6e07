"""Pass the newest value to another thread, and wake it."""

import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from app.geometry import MarginGuardError

if TYPE_CHECKING:
    from app.geometry import ImageSample

Item = TypeVar("Item")

SWITCH_INTERVAL_S = 0.0005
"""For ``sys.setswitchinterval`` in a program that displays live data, before it starts.

By default a computing thread keeps the interpreter lock for 5 ms, five times the whole latency from
a received pose to the scene.
"""


class LatestValue(Generic[Item]):
    """Holds one item: a newer one replaces one that has not been taken yet.

    `put` wakes a reader that waits in `take`. A reader that is slower than its source therefore
    lags by one item at most. The interpreter lock adds to the latency between two threads: see
    `SWITCH_INTERVAL_S`.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._items: list[Item] = []

    def put(self, item: Item) -> None:
        """Store ``item`` for the reader."""
        with self._changed:
            self._items[:] = [item]
            self._changed.notify()

    def take(self, timeout_s: float) -> Item | None:
        """Return the newest item as soon as there is one; None if none arrives in ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self._items, timeout_s)
            return self._items.pop() if self._items else None


class Wakeup:
    """Raised by `wake`, from any thread; lowered by `clear`, in the thread that displays.

    Many calls of `wake` before a `clear` count as one: while it is raised, one byte waits at
    `fileno`, which an event loop can watch. After `close` all calls are without effect.
    """

    _changed: ClassVar = threading.Condition()
    _raised: ClassVar["set[Wakeup]"] = set()
    """Raised flags of the whole process: the displaying thread waits for each of its flags."""

    def __init__(self) -> None:
        self._is_closed = False
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)

    def fileno(self) -> int:
        """The descriptor that can be read while the flag is raised; -1 after `close`."""
        return self._reader.fileno()

    def wake(self) -> None:
        """Raise the flag."""
        with self._changed:
            if self._is_closed or self in self._raised:
                return
            self._raised.add(self)
            self._writer.send(b"\0")
            self._changed.notify_all()

    def wait(self, timeout_s: float) -> bool:
        """Wait until this or another flag of the process is raised; True if it is this one.

        Other threads run meanwhile. Another flag ends the wait, so that the one thread that
        displays can attend to it.
        """
        with self._changed:
            if not self._raised:
                self._changed.wait(timeout_s)
            return self in self._raised

    def clear(self) -> None:
        """Lower the flag, before the data are read: a `wake` meanwhile raises it again."""
        with self._changed:
            if self in self._raised:
                self._raised.remove(self)
                self._reader.recv(1)

    def close(self) -> None:
        """Release the descriptors. Idempotent."""
        with self._changed:
            self._is_closed = True
            self._raised.discard(self)
            self._reader.close()
            self._writer.close()


WATCHDOG_MS = 100
"""Time without a call after which ``spin`` is called: a silent source must become stale."""

_SPIN_S = 0.005
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
        if self._wakeup.wait(_SPIN_S):
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


Received = TypeVar("Received")

_DECODE_WAIT_S = 0.2
"""Longest time after which `close` is noticed."""


class ImageSink(Protocol):
    """Receiver of decoded images, called in the thread of an `ImageIntake`."""

    def add(self, image: "ImageSample") -> None:
        """Take the next image."""

    def refuse(self, problem: str) -> None:
        """Take the reason why an image cannot be decoded."""


class ImageIntake(Generic[Received]):
    """Passes each received image through ``decode`` to ``images``; skips those it has no time for.

    ``decode`` is called in the thread of the intake. It returns None for what is no image for this
    session, and raises `MarginGuardError` for one that is refused.
    """

    def __init__(
        self, images: ImageSink, decode: "Callable[[Received], ImageSample | None]"
    ) -> None:
        self._images, self._decode = images, decode
        self._latest: LatestValue[Received] = LatestValue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="images", daemon=True)
        self._thread.start()

    def put(self, received: Received) -> None:
        """Take an image as it was received; from any thread, without waiting."""
        self._latest.put(received)

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._closing.is_set():
            received = self._latest.take(_DECODE_WAIT_S)
            if received is None:
                continue
            try:
                image = self._decode(received)
            except MarginGuardError as error:
                self._images.refuse(str(error))
                continue
            if image is not None:
                self._images.add(image)
