"""A flag by which any thread wakes the thread that displays, with a descriptor for its loop."""

import socket
import threading
from typing import ClassVar


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
