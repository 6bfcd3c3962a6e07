"""A limit on a rate. The clock is passed in."""

from app.geometry import NS_PER_S


class RateLimit:
    """A token bucket: ``burst`` units at once, ``per_s`` units a second in the long run.

    Times are those of one steady clock, in ns.
    """

    def __init__(self, per_s: float, burst: float) -> None:
        self._per_ns = per_s / NS_PER_S
        self._burst = burst
        self._left = burst
        self._last_ns: int | None = None

    def take(self, now_ns: int, cost: float = 1.0) -> bool:
        """Use ``cost`` units; return False, and use none, if fewer are left."""
        if not self.has(now_ns, cost):
            return False
        self._left -= cost
        return True

    def has(self, now_ns: int, cost: float = 1.0) -> bool:
        """True if `take` would return True."""
        self._refill(now_ns)
        return self._left >= cost

    def _refill(self, now_ns: int) -> None:
        if self._last_ns is not None:
            gained = max(now_ns - self._last_ns, 0) * self._per_ns
            self._left = min(self._left + gained, self._burst)
        self._last_ns = now_ns
