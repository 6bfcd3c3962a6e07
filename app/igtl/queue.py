"""Queue of samples between the receiving and the processing thread."""

import threading
from collections.abc import Sequence

from app.geometry import TrackedTransform


class SampleQueue:
    """FIFO queue that keeps only the newest sample of each edge on overflow.

    The queue overflows above ``max_samples``; it then holds one sample per edge. `superseded`
    counts the samples that were dropped for a newer one of the same edge.
    """

    def __init__(self, max_samples: int = 1_000) -> None:
        self.superseded = 0
        self._max_samples = max_samples
        self._samples: list[TrackedTransform] = []
        self._changed = threading.Condition()
        self._closed = False

    def put(self, samples: Sequence[TrackedTransform]) -> None:
        """Add ``samples`` and wake the thread that waits in `take`."""
        with self._changed:
            self._samples += samples
            if len(self._samples) > self._max_samples:
                newest = {(each.target, each.source): each for each in self._samples}
                self.superseded += len(self._samples) - len(newest)
                self._samples = list(newest.values())
            self._changed.notify()

    def clear(self) -> None:
        """Discard all samples, after the connection was lost."""
        with self._changed:
            self._samples = []

    def close(self) -> None:
        """End every `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[TrackedTransform] | None:
        """Wait up to ``timeout_s`` and remove all samples; None if the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._samples or self._closed, timeout_s)
            if self._closed:
                return None
            taken, self._samples = self._samples, []
            return taken
