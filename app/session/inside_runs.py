"""When a breach begins and ends: the one rule that the page, the report and the analysis share."""

from enum import Enum

from app.geometry import Freshness, FreshnessLimits, freshness_of


class InsideRun(Enum):
    """Relation of a frame to the breaches.

    ``UNKNOWN``: no distance, neither begins nor ends a breach. ``OUTSIDE``: ends one. ``BEGINS``:
    the first frame of a breach. ``CONTINUES``: a further frame of the last breach.
    """

    UNKNOWN = "unknown"
    OUTSIDE = "outside"
    BEGINS = "begins"
    CONTINUES = "continues"


class InsideRuns:
    """Divides the frames of a session into breaches, one frame after the other.

    A breach is a run of frames with a negative signed distance, whatever the state is, so that
    hysteresis neither lengthens nor joins breaches. Two inside frames that are more than
    ``stale_after_ns`` apart, or whose stamps run backwards, belong to two breaches.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._limits = FreshnessLimits(stale_after_ns)
        self._last_inside_ns: int | None = None

    def use(self, stale_after_ns: int) -> None:
        """Use another limit from the next frame on."""
        self._limits = FreshnessLimits(stale_after_ns)

    def observe(self, stamp_ns: int, signed_distance_mm: float | None) -> InsideRun:
        """The next frame; ``signed_distance_mm`` is None where it is not known."""
        if signed_distance_mm is None:
            return InsideRun.UNKNOWN
        if not signed_distance_mm < 0.0:
            self._last_inside_ns = None
            return InsideRun.OUTSIDE
        last_ns, self._last_inside_ns = self._last_inside_ns, stamp_ns
        if last_ns is None or freshness_of(last_ns, stamp_ns, self._limits) is not Freshness.VALID:
            return InsideRun.BEGINS
        return InsideRun.CONTINUES
