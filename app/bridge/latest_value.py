"""From the ROS thread to the thread that owns the scene, without a timer in between."""

import threading
from typing import Generic, TypeVar

Item = TypeVar("Item")

SWITCH_INTERVAL_S = 0.0005
"""For ``sys.setswitchinterval`` in a program that shows what comes, before it starts.

A thread that computes keeps the interpreter for 5 ms by default, five times what the whole way of
a pose into the scene takes.
"""


class LatestValue(Generic[Item]):
    """Room for one item: a newer one takes the place of one that nobody has taken yet.

    Whoever waits in `take` is woken by `put` itself. A reader that is slower than its source so
    stays behind by one item at most; `superseded` counts the items that it never saw. Between
    two threads of Python the interpreter's lock changes hands too: see `SWITCH_INTERVAL_S`.
    """

    def __init__(self) -> None:
        self.superseded = 0
        self._changed = threading.Condition()
        self._items: list[Item] = []

    def put(self, item: Item) -> None:
        """Leave ``item`` for the reader."""
        with self._changed:
            self.superseded += len(self._items)
            self._items[:] = [item]
            self._changed.notify()

    def take(self, timeout_s: float) -> Item | None:
        """The newest item, as soon as there is one; None when none came in ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self._items, timeout_s)
            return self._items.pop() if self._items else None
