"""The lag between two clocks, from two streams that saw the same motion.

``b(t) = M a(t - offset) + c`` with ``M`` and ``c`` unknown: the frames of the streams, the lever
arm between them and their scales need not be known, only that one is a linear image of the other.
For every offset they drop out by linear regression; what is left is one number to be found.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.optimize import minimize_scalar

from app.geometry import NS_PER_MS, NS_PER_S, FloatArray
from app.registration.errors import FlatSignalError, ShapeError, TooFewError
from app.registration.quantiles import student_quantile
from app.registration.robot_base.timed_signal import TimedSignal

MIN_SAMPLES = 40

RANK_TOLERANCE = 1e-3
"""Directions in which a moves less than this part of its greatest motion are left out: they could
only be fitted to noise."""

STEP_S = 0.005
"""The grid that is searched before the minimum is refined."""

KNOT_S = 0.06
SAMPLES_PER_KNOT = 3
"""Knots of the curve through a: far enough apart to average noise, near enough for any motion of
a hand or a robot (half a period at 4 Hz holds two of them)."""

MAX_GAP_S = 0.2
"""Longest silence of a stream that the curve through it may cross."""

CURVATURE_S = 0.02
"""Offset to either side at which the curvature of the loss is read."""

FLAT_RATIO = 0.5
"""Mean squared step over twice the variance: 1 for noise around a fixed value, near 0 for motion
that the sampling follows (von Neumann 1941)."""

MIN_EXPLAINED = 0.5
"""Least share of the motion of one stream that the other has to explain."""

RIVAL_SHARE = 0.02
"""Another offset that explains the motion as well but for this share makes the answer ambiguous."""

BLOCKS = 40
"""Stretches of the recording whose pulls on the offset are taken to be independent."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """``time on the clock of b = time on the clock of a + offset_ns``.

    ``interval_ns``
        95 % confidence interval, from how much stretches of the recording disagree, so that noise
        which is not white is counted.
    ``explained``
        Share of the motion of b that a explains at this offset, 0 to 1.
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
    """How much more the clock of ``b`` reads than that of ``a`` at the same moment.

    With a the robot's and b the tracker's stream this is the offset from robot to tracker time.
    Searched within ``search_s`` either way of ``around_ns`` (two clocks that started at different
    times need a first guess). Not accepted when the interval is wider than
    ``max_half_width_s`` either way, when the offset changes by more than that to either side of its
    mean over the recording (clocks that drift), when a explains too little of b, when the answer is
    at the end of the search, or when another offset fits as well (periodic motion). Raises
    `FlatSignalError` for a stream that does not move, `TooFewError` for too short an overlap.
    """
    for name, value in (("search_s", search_s), ("max_half_width_s", max_half_width_s)):
        if not (math.isfinite(value) and value > 0.0):
            raise ShapeError(f"{name} is {value}: above 0 wanted")
    _check_motion(a, "a")
    _check_motion(b, "b")
    alignment = _Alignment.of(a, b, around_ns, search_s)

    grid = np.linspace(-search_s, search_s, 2 * math.ceil(search_s / STEP_S) + 1)
    losses = np.array([alignment.loss(offset) for offset in grid])
    lowest = int(np.argmin(losses))
    around = grid[max(lowest - 1, 0)], grid[min(lowest + 1, len(grid) - 1)]
    offset = float(
        minimize_scalar(alignment.loss, bounds=around, method="bounded", options={"xatol": 1e-8}).x
    )
    half_width = alignment.half_width_s(offset)
    explained = 1.0 - alignment.loss(offset) / alignment.motion

    faults = _faults(grid, losses, alignment.motion)
    if explained < MIN_EXPLAINED:
        faults.append(f"{explained:.0%} of the motion is explained, {MIN_EXPLAINED:.0%} wanted")
    if half_width > max_half_width_s:
        faults.append(
            f"the offset is known to {1e3 * half_width:.2g} ms (95 %), "
            f"{1e3 * max_half_width_s:g} ms wanted"
        )
    drift = alignment.drift_s(offset)
    # Over an even stretch its half is sqrt(3) times less sure than the offset in the middle.
    if abs(drift) / 2.0 > max_half_width_s + math.sqrt(3.0) * half_width:
        faults.append(
            f"the clocks drift: the offset changes by {1e3 * drift:.2g} ms over the recording, "
            f"{2e3 * max_half_width_s:g} ms allowed"
        )
    finding = (
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
        reason="; ".join(faults) or finding,
    )


def _check_motion(signal: TimedSignal, name: str) -> None:
    if len(signal.times_ns) < MIN_SAMPLES:
        raise TooFewError(
            f"{len(signal.times_ns)} samples of signal {name}: at least {MIN_SAMPLES} wanted"
        )
    variance = float(np.sum(np.var(signal.values, axis=0)))
    steps = float(np.sum(np.mean(np.diff(signal.values, axis=0) ** 2, axis=0)))
    # Rounding of a constant is no motion, whatever its ratio.
    scale = float(np.max(np.abs(signal.values)))
    if variance <= (1e-9 * scale) ** 2 or steps > FLAT_RATIO * 2.0 * variance:
        raise FlatSignalError(
            f"signal {name} ({signal.clock}) does not move: standard deviation "
            f"{math.sqrt(variance):.3g}, RMS step {math.sqrt(steps):.3g} between samples"
        )


def _faults(grid: FloatArray, losses: FloatArray, motion: float) -> list[str]:
    """What is wrong with the shape of the loss over the search."""
    lowest = int(np.argmin(losses))
    if lowest in (0, len(grid) - 1):
        return [f"the best offset is at the end of the search, {1e3 * grid[lowest]:.0f} ms"]
    inner = losses[1:-1]
    valleys = np.flatnonzero((inner < losses[:-2]) & (inner <= losses[2:])) + 1
    return [
        f"an offset of {1e3 * grid[valley]:.0f} ms fits as well as {1e3 * grid[lowest]:.0f} ms"
        for valley in valleys
        if valley != lowest and losses[valley] - losses[lowest] < RIVAL_SHARE * motion
    ][:1]


@dataclass(frozen=True, slots=True, eq=False)
class _Alignment:
    """Both streams in s on a common zero, and a as a curve that can be read at any time."""

    curve: BSpline
    slope: BSpline
    times: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, a: TimedSignal, b: TimedSignal, around_ns: int, search_s: float) -> "_Alignment":
        a_times = (a.times_ns - a.times_ns[0]) / NS_PER_S
        b_times = (b.times_ns - a.times_ns[0] - around_ns) / NS_PER_S
        # The same samples of b for every offset, or the loss would jump where one drops out.
        inside = (b_times - search_s >= a_times[0]) & (b_times + search_s <= a_times[-1])
        # Nor samples that fall where a was silent: the curve is free to swing there.
        (silent,) = np.nonzero(np.diff(a_times) > MAX_GAP_S)
        for begin, end in zip(a_times[silent], a_times[silent + 1], strict=True):
            inside &= (b_times + search_s <= begin) | (b_times - search_s >= end)
        if inside.sum() < MIN_SAMPLES:
            raise TooFewError(
                f"{int(inside.sum())} samples of b are inside a for every offset within "
                f"{search_s:g} s: at least {MIN_SAMPLES} wanted"
            )
        spread = np.std(a.values, axis=0)
        moving = a.values[:, spread > 1e-9 * float(spread.max())]
        curve = _curve(a_times, moving / np.std(moving, axis=0))
        values = b.values[inside] - b.values[inside].mean(axis=0)
        return cls(curve, curve.derivative(), b_times[inside], values)

    @property
    def motion(self) -> float:
        """Sum of the squares of b about its mean."""
        return float(np.sum(self.values**2))

    def loss(self, offset: float) -> float:
        """Sum of the squares that no linear image of a, ``offset`` s later, explains of b."""
        return float(np.sum(self._fit(offset)[2] ** 2))

    def half_width_s(self, offset: float) -> float:
        """Half of the 95 % interval (sandwich estimate over blocks, Liang and Zeger 1986)."""
        basis, slope, misfit = self._sloped(offset)
        pull = np.sum(slope * misfit, axis=1)
        blocks = np.array([part.sum() for part in np.array_split(pull, BLOCKS)])
        # What the fit has taken up of the misfit is not seen in the pulls any more.
        columns = self.values.shape[1]
        freedom = BLOCKS * columns - (basis.shape[1] + 1) * columns - 1
        scatter = math.sqrt(float(np.sum(blocks**2)) * BLOCKS * columns / freedom)
        # Not the sum of squared slopes: the noise of the curve is in them and would be taken for
        # motion. The loss itself has that noise at every offset, so its curvature is of motion.
        beside = self.loss(offset - CURVATURE_S) + self.loss(offset + CURVATURE_S)
        curvature = (beside - 2.0 * self.loss(offset)) / (2.0 * CURVATURE_S**2)
        sigma = scatter / curvature if curvature > 0.0 else math.inf
        return student_quantile(0.975, BLOCKS - 1) * sigma

    def drift_s(self, offset: float) -> float:
        """How much more the offset is at the end than at the beginning, to first order."""
        _, slope, misfit = self._sloped(offset)
        weights = np.sum(slope**2, axis=1)
        apart = self.times - np.average(self.times, weights=weights)
        rate = float(apart @ np.sum(slope * misfit, axis=1)) / float(apart**2 @ weights)
        return rate * float(np.ptp(self.times))

    def _sloped(self, offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The basis, how what it explains rises with the offset (n, d), and the misfit."""
        basis, weights, misfit = self._fit(offset)
        slope = -(self.slope(self.times - offset) @ weights)
        return basis, slope - basis @ (basis.T @ slope), misfit

    def _fit(self, offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Orthonormal basis of a's columns at this offset, their weights in b, and the misfit."""
        columns = self.curve(self.times - offset)
        centred = columns - columns.mean(axis=0)
        left, values, right = np.linalg.svd(centred, full_matrices=False)
        kept = values > RANK_TOLERANCE * values[0]
        basis = left[:, kept]
        inside = basis.T @ self.values
        weights = right[kept].T @ (inside / values[kept, None])
        return basis, np.asarray(weights), np.asarray(self.values - basis @ inside)


def _curve(times: FloatArray, columns: FloatArray) -> BSpline:
    """Least-squares quintic spline through samples (n, d), knots at every few of them.

    Not an interpolating one: between noisy samples that has less noise than at them, which pulls
    the offset towards half sample periods.
    """
    period = float(np.median(np.diff(times)))
    stride = max(SAMPLES_PER_KNOT, round(KNOT_S / period))
    inner = times[stride:-stride:stride]
    knots = np.concatenate([[times[0]] * 6, inner, [times[-1]] * 6])
    return make_lsq_spline(times, columns, knots, k=5)
