"""Recent values by stamp, and the two around any moment, between which it is interpolated."""

from bisect import bisect_left
from collections.abc import Callable
from typing import Generic, TypeVar

_Value = TypeVar("_Value")

_COMPACT = 1024
"""Outdated values are removed from the front of the lists in batches of this size."""


class StampHistory(Generic[_Value]):
    """Values in the order of their stamps, whose order of arrival does not matter.

    Keeps values within ``keep_ns`` of the newest, at least ``min_values`` and at most
    ``max_values``. One that is older than the newest by more than ``restart_ns`` indicates a
    restarted source or a clock that was set back: it discards the others and is counted in
    `restarts`. Of two values with the same stamp ``merge(known, value)`` is kept.
    """

    def __init__(
        self,
        *,
        keep_ns: float,
        restart_ns: float,
        max_values: float,
        min_values: int = 1,
        merge: Callable[[_Value, _Value], _Value] = lambda known, value: known,
    ) -> None:
        self.restarts = 0
        self._keep_ns, self._restart_ns = keep_ns, restart_ns
        self._min_values, self._max_values = min_values, max_values
        self._merge = merge
        self._stamps: list[int] = []
        self._values: list[_Value] = []
        self._first = 0

    def insert(self, stamp_ns: int, value: _Value) -> bool:
        """Add a value; False if its stamp is known or too old."""
        stamps, values = self._stamps, self._values
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            values.append(value)
            self._remove_old()
            return True
        if stamp_ns < stamps[-1] - self._restart_ns:
            self._stamps, self._values, self._first = [stamp_ns], [value], 0
            self.restarts += 1
            return True
        index = bisect_left(stamps, stamp_ns, self._first)
        if stamps[index] == stamp_ns:
            values[index] = self._merge(values[index], value)
            return False
        if stamp_ns < stamps[-1] - self._keep_ns:
            return False
        stamps.insert(index, stamp_ns)
        values.insert(index, value)
        self._remove_old()
        return True

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest value; a history has at least one."""
        return self._stamps[-1]

    @property
    def oldest_ns(self) -> int:
        """Stamp of the oldest value."""
        return self._stamps[self._first]

    def around(self, stamp_ns: int) -> tuple[_Value, _Value, float] | None:
        """The values before and after ``stamp_ns``, and its place between them from 0 to 1.

        Both are the value at ``stamp_ns`` if there is one. None outside the range of the stamps.
        """
        stamps, values = self._stamps, self._values
        after = bisect_left(stamps, stamp_ns, self._first)
        if after == len(stamps):
            return None
        if stamps[after] == stamp_ns:
            return values[after], values[after], 0.0
        if after == self._first:
            return None
        before_ns = stamps[after - 1]
        fraction = (stamp_ns - before_ns) / (stamps[after] - before_ns)
        return values[after - 1], values[after], fraction

    def _remove_old(self) -> None:
        stamps = self._stamps
        oldest_kept_ns = stamps[-1] - self._keep_ns
        while (count := len(stamps) - self._first) > self._min_values and (
            stamps[self._first] < oldest_kept_ns or count > self._max_values
        ):
            self._first += 1
        if self._first >= _COMPACT:
            del stamps[: self._first], self._values[: self._first]
            self._first = 0
