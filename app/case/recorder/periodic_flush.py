"""Threads that flush and sync a recording, so that a crash loses little of it."""

import threading
from collections.abc import Callable
from typing import Self

from app.geometry import MarginGuardError

FLUSH_S = 0.02
"""Interval between flushes. A killed recorder loses the messages since the last one."""

SYNC_S = 1.0
"""Interval between syncs. A power cut loses the messages since the last one."""


class PeriodicFlush:
    """``with PeriodicFlush(flush, sync): ...`` calls both periodically, each in its own thread.

    ``sync`` may wait for the disk without delaying ``flush``. A `MarginGuardError` of either ends
    its thread; the functions raise it again when the owner of the recording calls them.
    """

    def __init__(
        self,
        flush: Callable[[], None],
        sync: Callable[[], None],
        *,
        flush_s: float = FLUSH_S,
        sync_s: float = SYNC_S,
    ) -> None:
        self._stopped = threading.Event()
        self._threads = [
            threading.Thread(target=self._repeat, args=(flush, flush_s), name="flush", daemon=True),
            threading.Thread(target=self._repeat, args=(sync, sync_s), name="sync", daemon=True),
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join()

    def _repeat(self, act: Callable[[], None], interval_s: float) -> None:
        while not self._stopped.wait(interval_s):
            try:
                act()
            except MarginGuardError:
                return
