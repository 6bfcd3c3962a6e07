"""The frame rate that the measured cost of a picture allows."""

from app.geometry import NS_PER_S

MAX_LOAD = 0.85
"""Share of the time that drawing may take; above it a backlog builds up."""
LOAD_BESIDE_CONTROLLER = 0.3
"""The same on a machine that also controls an arm."""
_MAX_HZ, _MIN_HZ = 30.0, 2.0
_SMOOTHING = 0.8
"""Weight of the last estimate after a cheaper picture; a costlier one counts at once."""


class FrameRate:
    """Computes the period of pictures from their cost: drawing takes at most ``max_load``."""

    def __init__(self, max_load: float = MAX_LOAD) -> None:
        self._max_load = max_load
        self._cost_ns = 0.0

    def record(self, cost_ns: int) -> None:
        """Take the time in ns for which the last picture has occupied the thread."""
        smoothed_ns = _SMOOTHING * self._cost_ns + (1.0 - _SMOOTHING) * cost_ns
        self._cost_ns = max(float(cost_ns), smoothed_ns)

    @property
    def period_ns(self) -> int:
        """Time in ns from the start of one picture to the start of the next."""
        period_ns = self._cost_ns / self._max_load
        return round(min(max(period_ns, NS_PER_S / _MAX_HZ), NS_PER_S / _MIN_HZ))
