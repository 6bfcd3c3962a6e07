"""The offset between two clocks, from two signals of the same motion.

``b(t) = M a(t - offset) + c`` with ``M`` and ``c`` unknown: the frames of the signals, the lever
arm between them and their scales need not be known. For each offset, ``M`` and ``c`` follow from
linear regression, so the search has one unknown.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.optimize import minimize_scalar

from app.geometry import NS_PER_MS, NS_PER_S, FloatArray
from app.registration.consensus import student_quantile
from app.registration.input_checks import (
    FlatSignalError,
    TooFewError,
    check_positive,
)
from app.registration.pose_stack import TimedSignal

MIN_SAMPLES = 40

RANK_TOLERANCE = 1e-3
"""Directions in which the motion of a is below this fraction of its largest are not used: they
contain mainly noise."""

STEP_S = 0.005
"""Step of the grid search before the minimum is refined."""

KNOT_S = 0.06
SAMPLES_PER_KNOT = 3
"""Spacing of the spline knots of a: wide enough to average noise, close enough for motion of a hand
or a robot (two knots in half a period at 4 Hz)."""

MAX_GAP_S = 0.2
"""Longest gap between samples of a across which the spline is used."""

CURVATURE_S = 0.02
"""Step of the finite difference for the curvature of the loss."""

FLAT_RATIO = 0.5
"""Maximum ratio of the mean squared step to twice the variance: 1 for white noise, near
0 for motion that the sampling resolves (von Neumann 1941)."""

MIN_EXPLAINED = 0.5
"""Minimum share of the motion of b that a has to explain."""

AMBIGUITY_SHARE = 0.02
"""Another minimum within this share of the motion makes the offset ambiguous."""

BLOCKS = 40
"""Number of segments of the recording whose gradients are treated as independent."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """Clock offset: time on the clock of b = time on the clock of a + ``offset_ns``.

    ``interval_ns``
        95 % confidence interval, estimated from the scatter between segments of the recording, so
        it holds for coloured noise, too.
    ``explained``
        Share of the motion of b that a explains at this offset, 0 to 1.
    ``accepted``, ``reason``
        Whether the offset may be used, and one line that explains it in either case.
    """

    offset_ns: int
    interval_ns: tuple[int, int]
    explained: float
    clock_a: str
    clock_b: str
    accepted: bool
    reason: str


def estimate_time_offset(
    a: TimedSignal,
    b: TimedSignal,
    *,
    around_ns: int = 0,
    search_s: float = 0.5,
    max_half_width_s: float = 0.005,
) -> TimeOffset:
    """Estimate how much more the clock of ``b`` reads than that of ``a`` at the same time.

    If a is the robot's and b the tracker's signal, this is the offset from robot to tracker time.
    Offsets within ``search_s`` of ``around_ns`` are searched; clocks that started at different
    times need a first guess ``around_ns``. Not accepted if

    - the half width of the interval is above ``max_half_width_s``,
    - the offset deviates by more than that from its mean over the recording (clock drift),
    - a explains too little of b,
    - the best offset is at an end of the search,
    - another offset fits equally well (periodic motion).

    Raises `FlatSignalError` for a signal without motion, `TooFewError` for too few samples or too
    short an overlap, `ShapeError` for limits out of range.
    """
    check_positive(search_s, "search_s")
    check_positive(max_half_width_s, "max_half_width_s")
    _check_motion(a, "a")
    _check_motion(b, "b")
    alignment = _Alignment.from_signals(a, b, around_ns, search_s)

    grid = np.linspace(-search_s, search_s, 2 * math.ceil(search_s / STEP_S) + 1)
    losses = np.array([alignment.loss(offset) for offset in grid])
    best = int(np.argmin(losses))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    offset = float(
        minimize_scalar(alignment.loss, bounds=around, method="bounded", options={"xatol": 1e-8}).x
    )
    half_width = alignment.half_width_s(offset)
    explained = 1.0 - alignment.loss(offset) / alignment.motion

    faults = _loss_faults(grid, losses, alignment.motion)
    if explained < MIN_EXPLAINED:
        faults.append(
            f"{explained:.0%} of the motion is explained; expected at least {MIN_EXPLAINED:.0%}"
        )
    if half_width > max_half_width_s:
        faults.append(
            f"the offset is known to {1e3 * half_width:.2g} ms (95 %); "
            f"expected at most {1e3 * max_half_width_s:g} ms"
        )
    drift = alignment.drift_s(offset)
    # For uniform motion, the sigma of half the drift is sqrt(3) times that of the mean offset.
    if abs(drift) / 2.0 > max_half_width_s + math.sqrt(3.0) * half_width:
        faults.append(
            f"the clocks drift: the offset changes by {1e3 * drift:.2g} ms over the recording; "
            f"expected at most {2e3 * max_half_width_s:g} ms"
        )
    detail = (
        f"{1e3 * offset + around_ns / NS_PER_MS:.2f} ms within {1e3 * half_width:.2g} ms (95 %), "
        f"{explained:.1%} of the motion explained"
    )
    return TimeOffset(
        offset_ns=round(offset * NS_PER_S) + around_ns,
        interval_ns=(
            round((offset - half_width) * NS_PER_S) + around_ns,
            round((offset + half_width) * NS_PER_S) + around_ns,
        ),
        explained=explained,
        clock_a=a.clock,
        clock_b=b.clock,
        accepted=not faults,
        reason="; ".join(faults) or detail,
    )


def _check_motion(signal: TimedSignal, name: str) -> None:
    if len(signal.times_ns) < MIN_SAMPLES:
        raise TooFewError(
            f"{len(signal.times_ns)} samples of signal {name}; expected at least {MIN_SAMPLES}"
        )
    variance = float(np.sum(np.var(signal.values, axis=0)))
    steps = float(np.sum(np.mean(np.diff(signal.values, axis=0) ** 2, axis=0)))
    # Rounding of a constant may have any ratio.
    scale = float(np.max(np.abs(signal.values)))
    if variance <= (1e-9 * scale) ** 2 or steps > FLAT_RATIO * 2.0 * variance:
        raise FlatSignalError(
            f"signal {name} ({signal.clock}) does not move: standard deviation "
            f"{math.sqrt(variance):.3g}, RMS step {math.sqrt(steps):.3g} between samples; expected "
            "motion that the sampling resolves"
        )


def _loss_faults(grid: FloatArray, losses: FloatArray, motion: float) -> list[str]:
    """Return reasons for rejection from the shape of the loss over the search grid."""
    best = int(np.argmin(losses))
    if best in (0, len(grid) - 1):
        return [f"the best offset is at the end of the search, {1e3 * grid[best]:.0f} ms"]
    inner = losses[1:-1]
    minima = np.flatnonzero((inner < losses[:-2]) & (inner <= losses[2:])) + 1
    return [
        f"an offset of {1e3 * grid[other]:.0f} ms fits as well as {1e3 * grid[best]:.0f} ms"
        for other in minima
        if other != best and losses[other] - losses[best] < AMBIGUITY_SHARE * motion
    ][:1]


@dataclass(frozen=True, slots=True, eq=False)
class _Alignment:
    """Both signals on a common time axis in s; a as a spline."""

    curve: BSpline
    slope: BSpline
    times: FloatArray
    values: FloatArray

    @classmethod
    def from_signals(
        cls, a: TimedSignal, b: TimedSignal, around_ns: int, search_s: float
    ) -> "_Alignment":
        a_times = (a.times_ns - a.times_ns[0]) / NS_PER_S
        b_times = (b.times_ns - a.times_ns[0] - around_ns) / NS_PER_S
        # The same samples of b for every offset: otherwise the loss would jump.
        inside = (b_times - search_s >= a_times[0]) & (b_times + search_s <= a_times[-1])
        # Exclude samples in gaps of a, where the spline is not determined.
        (gaps,) = np.nonzero(np.diff(a_times) > MAX_GAP_S)
        for begin, end in zip(a_times[gaps], a_times[gaps + 1], strict=True):
            inside &= (b_times + search_s <= begin) | (b_times - search_s >= end)
        if inside.sum() < MIN_SAMPLES:
            raise TooFewError(
                f"{int(inside.sum())} samples of b are inside a for every offset within "
                f"{search_s:g} s; expected at least {MIN_SAMPLES}"
            )
        spread = np.std(a.values, axis=0)
        moving = a.values[:, spread > 1e-9 * float(spread.max())]
        curve = _fit_spline(a_times, moving / np.std(moving, axis=0))
        values = b.values[inside] - b.values[inside].mean(axis=0)
        return cls(curve, curve.derivative(), b_times[inside], values)

    @property
    def motion(self) -> float:
        """Sum of squares of b about its mean."""
        return float(np.sum(self.values**2))

    def loss(self, offset: float) -> float:
        """Sum of squared residuals of b after regression on a, ``offset`` s later."""
        return float(np.sum(self._fit(offset)[2] ** 2))

    def half_width_s(self, offset: float) -> float:
        """Half width of the 95 % interval (sandwich estimate over blocks, Liang and Zeger 1986)."""
        basis, slope, misfit = self._fit_with_slope(offset)
        gradient = np.sum(slope * misfit, axis=1)
        blocks = np.array([part.sum() for part in np.array_split(gradient, BLOCKS)])
        # Degrees of freedom: the regression reduces the misfit.
        columns = self.values.shape[1]
        freedom = BLOCKS * columns - (basis.shape[1] + 1) * columns - 1
        scatter = math.sqrt(float(np.sum(blocks**2)) * BLOCKS * columns / freedom)
        # The sum of squared slopes would count noise of the spline as motion. The loss contains
        # that noise at every offset, so its curvature is due to motion only.
        beside = self.loss(offset - CURVATURE_S) + self.loss(offset + CURVATURE_S)
        curvature = (beside - 2.0 * self.loss(offset)) / (2.0 * CURVATURE_S**2)
        sigma = scatter / curvature if curvature > 0.0 else math.inf
        return student_quantile(0.975, BLOCKS - 1) * sigma

    def drift_s(self, offset: float) -> float:
        """Change of the offset in s from the first to the last sample, to first order."""
        _, slope, misfit = self._fit_with_slope(offset)
        weights = np.sum(slope**2, axis=1)
        centred = self.times - np.average(self.times, weights=weights)
        rate = float(centred @ np.sum(slope * misfit, axis=1)) / float(centred**2 @ weights)
        return rate * float(np.ptp(self.times))

    def _fit_with_slope(self, offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the basis, the derivative of the fit by the offset, and the misfit (n, d)."""
        basis, weights, misfit = self._fit(offset)
        slope = -(self.slope(self.times - offset) @ weights)
        return basis, slope - basis @ (basis.T @ slope), misfit

    def _fit(self, offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return an orthonormal basis of a at ``offset``, the regression weights and the misfit."""
        columns = self.curve(self.times - offset)
        centred = columns - columns.mean(axis=0)
        left, values, right = np.linalg.svd(centred, full_matrices=False)
        significant = values > RANK_TOLERANCE * values[0]
        basis = left[:, significant]
        coefficients = basis.T @ self.values
        weights = right[significant].T @ (coefficients / values[significant, None])
        return basis, np.asarray(weights), np.asarray(self.values - basis @ coefficients)


def _fit_spline(times: FloatArray, columns: FloatArray) -> BSpline:
    """Fit a quintic least-squares spline to samples (n, d).

    An interpolating spline has less noise between samples than at them, which biases the offset
    towards half sample periods.
    """
    period = float(np.median(np.diff(times)))
    stride = max(SAMPLES_PER_KNOT, round(KNOT_S / period))
    inner = times[stride:-stride:stride]
    knots = np.concatenate([[times[0]] * 6, inner, [times[-1]] * 6])
    return make_lsq_spline(times, columns, knots, k=5)
