"""Whether the cautery burns, as its generator says it. Display and record only."""

from enum import StrEnum

from app.geometry import Freshness, FreshnessLimits, freshness_of


class CauteryState(StrEnum):
    """Known state of the cautery; a higher rank prevails in a summary of several moments."""

    OFF = "off"
    UNKNOWN = "unknown"
    ON = "on"

    @property
    def label(self) -> str:
        """Capitals, for displays."""
        return self.value.upper()

    @property
    def symbol(self) -> str:
        """A sign that differs without colour."""
        return {"off": "\N{WHITE CIRCLE}", "unknown": "?", "on": "\N{BLACK CIRCLE}"}[self.value]

    @property
    def rank(self) -> int:
        """Position among the states."""
        return list(CauteryState).index(self)


class CauteryTrail:
    """Last report of the cautery, on any clock in ns. Not older than ``stale_after_ns``.

    A source that has said nothing, or too long ago, leaves the state unknown: never off.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._limits = FreshnessLimits(stale_after_ns, future_tolerance_ns=stale_after_ns)
        self._last: tuple[int, bool] | None = None

    def hear(self, on: bool, at_ns: int) -> None:
        """Take what the source says at ``at_ns``; from any thread."""
        self._last = at_ns, on

    def forget(self) -> None:
        """Take that the source cannot be understood; from any thread."""
        self._last = None

    def at(self, now_ns: int) -> CauteryState:
        """The state at ``now_ns``."""
        last = self._last
        if last is None or freshness_of(last[0], now_ns, self._limits) is not Freshness.VALID:
            return CauteryState.UNKNOWN
        return CauteryState.ON if last[1] else CauteryState.OFF
