"""Slow drift: the mean difference between the tool by tracker and by joints."""

import math

from app.geometry import NS_PER_S, Stamp
from app.session.plausibility.vectors import ZERO, Vector

MEAN_S = 0.25
"""Time constant of the mean. It removes the jitter of the tracker, so that a difference that stays
is found below the bound of a single one; a constant error of velocity v appears as v times this."""

SHARE_OF_BOUND = 0.5
"""Default limit, as a share of the bound of a single difference. In the simulated case, with a
registration error, breath and jitter, the mean reaches a quarter of the bound of 5 mm."""

START_NS = NS_PER_S
"""Time after the first difference from which the mean's start is fixed: four time constants."""


class MeanDrift:
    """Mean of differences (3,) in mm, tracked minus predicted, with exponential weights.

    It is exceeded if both the mean and its change since the start are longer than ``limit_mm``: the
    error of an accepted registration, which is there from the start, is no drift. An error that
    grows at ``r`` mm/s from 0 is found before it is ``limit_mm + r * MEAN_S``, and from a constant
    error of ``e`` mm before ``limit_mm + e + r * MEAN_S``.
    """

    def __init__(self, limit_mm: float) -> None:
        self.limit_mm = limit_mm
        self._mean: Vector = ZERO
        self._start: Vector = ZERO
        self._first_ns: int | None = None
        self._last_ns = 0
        self._elapsed_ns = 0
        """Time measured before the clock was set back."""

    @property
    def length_mm(self) -> float:
        """Length of the mean."""
        return math.hypot(*self._mean)

    def update(self, difference: Vector, now: Stamp) -> None:
        """Add a difference measured at ``now``."""
        since_ns = now.ns - self._last_ns
        if self._first_ns is None:
            self._first_ns, since_ns = now.ns, 0
            self._mean = self._start = difference
        elif since_ns < 0:  # the source's clock was set back: what has drifted stays drifted
            self._elapsed_ns += self._last_ns - self._first_ns
            self._first_ns, since_ns = now.ns, 0
            self._mean = difference
        self._last_ns = now.ns
        share = 1.0 - math.exp(-since_ns / (MEAN_S * NS_PER_S))
        a, b, c = self._mean
        x, y, z = difference
        self._mean = (a + share * (x - a), b + share * (y - b), c + share * (z - c))
        if self._elapsed_ns + now.ns - self._first_ns <= START_NS:
            self._start = self._mean

    @property
    def exceeded(self) -> bool:
        """True if the mean has left its limit."""
        return self.length_mm > self.limit_mm and math.dist(self._mean, self._start) > self.limit_mm

    @property
    def text(self) -> str:
        """The mean and its limit."""
        return (
            f"the tool is {self.length_mm:.3g} mm from its position by the joints in the mean; "
            f"expected at most {self.limit_mm:g} mm"
        )
