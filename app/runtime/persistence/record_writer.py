"""A thread that writes the newest record to disk, so that no step waits for a disk."""

import threading
from collections.abc import Callable

from app.geometry import MarginGuardError
from app.runtime.latest_value import LatestValue
from app.runtime.persistence.run_record import RunRecord

BEAT_S = 1.0
"""Interval of the calls of ``beat``."""

_CLOSE_S = 5.0


class RecordWriter:
    """Calls ``write(record)`` in a thread of its own, for the newest record only.

    `put` returns at once, whatever the disk does. ``beat()`` is called every `BEAT_S` and after
    each write. The first failure of either is passed to ``failed`` in that thread; later ones are
    silent until one succeeds.
    """

    def __init__(
        self,
        write: Callable[[RunRecord], None],
        beat: Callable[[], None],
        failed: Callable[[str], None],
    ) -> None:
        self._write = write
        self._beat = beat
        self._failed = failed
        self._latest: LatestValue[RunRecord] = LatestValue()
        self._closing = threading.Event()
        self._has_failed = False
        self._thread = threading.Thread(target=self._work, name="hold record", daemon=True)
        self._thread.start()

    def put(self, record: RunRecord) -> None:
        """Write ``record`` soon; it replaces one that has not been written yet."""
        self._latest.put(record)

    def close(self, last: RunRecord) -> bool:
        """Write ``last`` and end the thread; False if the disk takes longer than 5 s."""
        self._latest.put(last)
        self._closing.set()
        self._thread.join(_CLOSE_S)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while True:
            is_last = self._closing.is_set()
            record = self._latest.take(0.0 if is_last else BEAT_S)
            try:
                if record is not None:
                    self._write(record)
                self._beat()
                self._has_failed = False
            except (MarginGuardError, OSError) as error:
                if not self._has_failed:
                    self._has_failed = True
                    self._failed(str(error))
            if is_last:
                return
