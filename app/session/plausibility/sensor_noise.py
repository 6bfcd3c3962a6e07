"""Noise of one sensor, learned from the differences between predicted and measured poses."""

SHARE = 1.0 / 32.0
"""Weight of a new difference: the noise is a mean over about 32 samples."""


class SensorNoise:
    """Standard deviation per axis, between ``min_sigma`` and ``max_sigma``, in any unit.

    It starts at ``max_sigma``, so that nothing is refused before the sensor is known. Motion that
    the prediction does not follow counts as noise too, up to ``max_sigma``: the gate is widest
    while the sensor is accelerated, and narrow where it rests.
    """

    def __init__(self, min_sigma: float, max_sigma: float) -> None:
        self._min, self._max = min_sigma * min_sigma, max_sigma * max_sigma
        self.variance = self._max
        """Variance of one axis."""

    def update(self, squared: float, factor: float) -> None:
        """Add a squared length of a difference whose variance is ``factor`` times the noise's."""
        variance = min(squared / (3.0 * factor), self._max)
        self.variance = max(self.variance + SHARE * (variance - self.variance), self._min)
