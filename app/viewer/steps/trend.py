"""Trend of the signed distance: approaching, steady or retreating."""

from collections import deque
from enum import StrEnum

from app.geometry import NS_PER_MS, NS_PER_S

_WINDOW_NS = 300 * NS_PER_MS
_STEADY_MM_S = 2.0
"""Below this speed a change within the window is noise of the tracker."""


class Trend(StrEnum):
    """Direction of change of the signed distance."""

    APPROACHING = "approaching"
    STEADY = "steady"
    RETREATING = "retreating"
    NONE = ""
    """Not enough samples."""


class TrendMeter:
    """Trend over the last 0.3 s; an unknown distance or a jump in time resets it."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float]] = deque()

    def update(self, stamp_ns: int, signed_distance_mm: float | None) -> Trend:
        """Add the distance of one step, None if unknown; return the trend."""
        points = self._points
        if points and not 0 < stamp_ns - points[-1][0] <= _WINDOW_NS:
            points.clear()
        if signed_distance_mm is None:
            points.clear()
            return Trend.NONE
        points.append((stamp_ns, signed_distance_mm))
        while stamp_ns - points[0][0] > _WINDOW_NS:
            points.popleft()
        span_ns = stamp_ns - points[0][0]
        if span_ns < _WINDOW_NS // 3:
            return Trend.NONE
        speed_mm_s = (signed_distance_mm - points[0][1]) / (span_ns / NS_PER_S)
        if abs(speed_mm_s) < _STEADY_MM_S:
            return Trend.STEADY
        return Trend.RETREATING if speed_mm_s > 0.0 else Trend.APPROACHING
