"""Pass the newest value from one thread to another, without a timer."""

import threading
from typing import Generic, TypeVar

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
