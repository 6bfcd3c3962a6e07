"""Samples on their way from the thread that reads them to the one that sends them on."""

import threading
from collections.abc import Sequence

from app.geometry import TrackedTransform


class SampleQueue:
    """Everything in its order while the taker keeps up; of each edge the newest when it does not.

    ``most`` samples wait at most (or one an edge, where there are more edges). `superseded` counts
    those that a newer one of the same edge replaced.
    """

    def __init__(self, most: int = 1_000) -> None:
        self.superseded = 0
        self._most = most
        self._samples: list[TrackedTransform] = []
        self._changed = threading.Condition()
        self._closed = False

    def put(self, samples: Sequence[TrackedTransform]) -> None:
        """Leave ``samples`` for the taker, who is woken."""
        with self._changed:
            self._samples += samples
            if len(self._samples) > self._most:
                newest = {(each.target, each.source): each for each in self._samples}
                self.superseded += len(self._samples) - len(newest)
                self._samples = list(newest.values())
            self._changed.notify()

    def clear(self) -> None:
        """Forget what waits: what it came from is gone."""
        with self._changed:
            self._samples = []

    def close(self) -> None:
        """End every `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[TrackedTransform] | None:
        """All that waits, at once when something does, else after the timeout; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._samples or self._closed, timeout_s)
            if self._closed:
                return None
            taken, self._samples = self._samples, []
            return taken
