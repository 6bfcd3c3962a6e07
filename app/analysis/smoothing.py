"""Smoothing of a distance over time, and the jitter of its measurement.

The jitter of a tracker moves the measured distance of a tool that rests. It is estimated from the
whole case: a polynomial is removed in windows of one or two seconds, windows in which the tool
moves much are left out, and what remains is explained by `app.geometry.correlated_noise`. Jitter
slower than some 1 Hz cannot be told from motion; it is continued by a model, which is stated there.

The distance is smoothed by Gaussian process regression: the function is a Matern process of
smoothness 7/2 about a polynomial with a flat prior (Rasmussen and Williams, "Gaussian Processes for
Machine Learning", 2006, sections 2.2, 2.7, 4.2 and 5.4.1). Length and amplitude of the process are
not chosen but averaged over a grid, weighted by their restricted marginal likelihood.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from app.geometry import FloatArray, InputError
from app.geometry.correlated_noise import Correlation, estimate_noise

WINDOW_S = 2.0
MIN_WINDOW = 12
"""Samples of a window; fewer leave too little for the noise after the polynomial is removed."""
DEGREE = 4
MAX_WINDOWS = 120
MAX_RATE_HZ = 100.0
"""Rate of the samples that are used, at most: every second, third, ... of faster ones."""
LONGEST_S = 10.0
"""Jitter slower than this, or than the case, is constant over a breach and not in the estimate."""
MIN_SIGMA_MM = 1e-3
"""Quantisation and the tolerance of a distance; also of a case without jitter."""
LENGTHS_S = (0.04, 0.08, 0.16, 0.32, 0.64, 1.28)
AMPLITUDES = tuple(2.0**k for k in range(-2, 10))
"""Length scales, and amplitudes in standard deviations of the jitter, with equal prior weights."""
_MIN_WEIGHT = 2e-3


@dataclass(frozen=True, slots=True)
class Jitter:
    """Noise of a distance: covariance ``sigma^2 ((1 - w) [s = t] + w exp(-|t - s| / tau))``.

    ``sigma_mm``: standard deviation. ``correlated``: the share ``w``, 0 for white noise.
    ``correlation_s``: ``tau``. ``windows``: how many were used, 0 for a jitter that was given.
    ``correlation``: where it was estimated, a sum of several processes instead of one; ``w`` is
    then their share and ``tau`` their mean. Raises `InputError` for values out of range.
    """

    sigma_mm: float
    correlated: float = 0.0
    correlation_s: float = 0.01
    windows: int = 0
    correlation: Correlation | None = None

    def __post_init__(self) -> None:
        for name, low, high in (
            ("sigma_mm", MIN_SIGMA_MM, 100.0),
            ("correlated", 0.0, 1.0),
            ("correlation_s", 1e-4, 100.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"jitter: {name} is {value:g}; expected {low:g} to {high:g}")

    def covariance(self, times_s: FloatArray) -> FloatArray:
        """Covariance (n, n) in mm2 of the noise at ``times_s`` (n,)."""
        single = Correlation((self.correlated,), (self.correlation_s,))
        return self.sigma_mm**2 * (self.correlation or single).matrix(times_s)


def estimate_jitter(times_s: FloatArray, distances_mm: FloatArray) -> Jitter | None:
    """The jitter of ``distances_mm`` (n,) at the increasing ``times_s`` (n,); None if unknown.

    Unknown are fewer than three windows. Below some 1 Hz the jitter is not measured but continued
    by a model, down to `LONGEST_S` or the duration of the case.
    """
    windows = _windows(times_s)
    if len(windows) < 3:
        return None
    variance, correlation, used = estimate_noise(
        np.array([times_s[window] for window in windows]),
        np.array([distances_mm[window] for window in windows]),
        degree=DEGREE,
        overlap=_OVERLAP,
        longest=min(LONGEST_S, float(times_s[-1] - times_s[0]) / (2.0 * math.pi)),
    )
    share = min(1.0, sum(correlation.shares))
    times = zip(correlation.shares, correlation.times, strict=True)
    mean_s = sum(part * time_s for part, time_s in times) / share if share > 0.0 else 0.01
    sigma_mm = max(math.sqrt(variance), MIN_SIGMA_MM)
    return Jitter(sigma_mm, share, mean_s, used, correlation)


_OVERLAP = 0.6
"""Share of the samples that no other window repeats, of windows that begin every half window."""


def _windows(times_s: FloatArray) -> list[NDArray[np.intp]]:
    """Indices of windows of equal length without gaps, spread over the case."""
    if len(times_s) < 3 * MIN_WINDOW:
        return []
    steps = np.diff(times_s)
    period_s = float(np.median(steps))
    if period_s <= 0.0:
        return []
    stride = max(1, round(1.0 / (period_s * MAX_RATE_HZ)))
    length = stride * max(MIN_WINDOW, round(WINDOW_S / (period_s * stride)))
    length = min(length, max(stride * MIN_WINDOW, round(1.0 / period_s), len(times_s) // 5))
    starts = np.arange(0, len(times_s) - length + 1, length // 2)
    usable = [
        np.arange(start, start + length, stride)
        for start in starts.tolist()
        if steps[start : start + length - 1].max() < 3.0 * period_s
        and steps[start : start + length - 1].min() > 0.0
    ]
    every = max(1, -(-len(usable) // MAX_WINDOWS))
    return usable[::every]


@dataclass(frozen=True, slots=True, eq=False)
class Smoothing:
    """The posterior of the function on a grid (m,), and how its mean follows from the samples.

    ``parts`` are pairs of a weight and the mean (m,) and covariance (m, m) of one process; the
    weights sum to 1. ``gain`` (m, n) maps the samples to the mean over all processes.
    """

    parts: tuple[tuple[float, FloatArray, FloatArray], ...]
    gain: FloatArray


def smooth(
    times_s: FloatArray,
    values_mm: FloatArray,
    noise: Jitter,
    grid_s: FloatArray,
    *,
    degree: int,
    max_acceleration_mm_s2: float = math.inf,
) -> Smoothing:
    """Smooth ``values_mm`` (n,) at the increasing ``times_s`` (n,), and evaluate at ``grid_s``.

    ``degree``: of the polynomial; lowered where there are too few samples. Processes whose
    acceleration has a standard deviation above ``max_acceleration_mm_s2`` are left out.
    """
    count = len(times_s)
    degree = min(degree, count - 1)
    centre = 0.5 * (times_s[0] + times_s[-1])
    half = max(0.5 * (times_s[-1] - times_s[0]), 1e-3)
    powers = np.arange(degree + 1)
    basis = ((grid_s - centre) / half)[:, None] ** powers
    trend = ((times_s - centre) / half)[:, None] ** powers
    covariance = noise.covariance(times_s)
    lag = np.abs(times_s[:, None] - times_s[None, :])
    fits = []
    factor = np.linalg.cholesky(covariance)
    white = solve_triangular(factor, np.column_stack([values_mm, trend]), lower=True)
    for length in LENGTHS_S:
        half_white = solve_triangular(factor, _matern(lag, length), lower=True)
        spectrum, vectors = np.linalg.eigh(solve_triangular(factor, half_white.T, lower=True))
        rotated = vectors.T @ white
        for index, scale in enumerate(AMPLITUDES):
            amplitude = scale * noise.sigma_mm
            if index == 0 or _acceleration(amplitude, length) <= max_acceleration_mm_s2:
                variances = 1.0 + amplitude**2 * np.maximum(spectrum, 0.0)
                fits.append((_evidence(rotated, variances), length, amplitude**2))
    best = max(fit for fit, _, _ in fits)
    weights = np.exp([fit - best for fit, _, _ in fits])
    weights[weights < _MIN_WEIGHT * weights.sum()] = 0.0
    weights /= weights.sum()
    gain = np.zeros((len(grid_s), count))
    parts = []
    for (_, length, variance), weight in zip(fits, weights.tolist(), strict=True):
        if weight == 0.0:
            continue
        linear, spread = _posterior(
            times_s,
            grid_s,
            trend,
            basis,
            variance * _matern(lag, length) + covariance,
            length,
            variance,
        )
        gain += weight * linear
        parts.append((weight, linear @ values_mm, spread))
    return Smoothing(tuple(parts), gain)


def _matern(lag: FloatArray, length: float) -> FloatArray:
    scaled = math.sqrt(7.0) * lag / length
    polynomial = 1.0 + scaled * (1.0 + scaled * (0.4 + scaled / 15.0))
    return np.asarray(polynomial * np.exp(-scaled))


def _acceleration(amplitude: float, length: float) -> float:
    """Standard deviation of the second derivative: the fourth derivative of the kernel at 0."""
    return math.sqrt(49.0 / 5.0) * amplitude / length**2


def _evidence(data_and_trend: FloatArray, variances: FloatArray) -> float:
    """Logarithm of the restricted likelihood, up to a constant (equation 2.45 of the book).

    ``data_and_trend`` (n, 1 + p) are in coordinates in which the covariance is diagonal, with
    ``variances`` (n,).
    """
    scaled = data_and_trend / np.sqrt(variances)[:, None]
    data, basis = scaled[:, 0], scaled[:, 1:]
    information = basis.T @ basis
    projected = basis.T @ data
    quadratic = data @ data - projected @ np.linalg.solve(information, projected)
    log_det = np.log(variances).sum() + np.linalg.slogdet(information)[1]
    return float(-0.5 * (quadratic + log_det))


def _posterior(
    times: FloatArray,
    grid: FloatArray,
    trend: FloatArray,
    basis: FloatArray,
    covariance: FloatArray,
    length: float,
    variance: float,
) -> tuple[FloatArray, FloatArray]:
    """Map (m, n) from samples to the mean, and covariance (m, m) (equations 2.41, 2.42)."""
    cross = variance * _matern(np.abs(grid[:, None] - times[None, :]), length)
    solved = np.linalg.solve(covariance, np.column_stack([trend, cross.T]))
    inverse_trend, weights = solved[:, : trend.shape[1]], solved[:, trend.shape[1] :].T
    information = trend.T @ inverse_trend
    to_trend = np.linalg.solve(information, inverse_trend.T)
    rest = basis - weights @ trend
    prior = variance * _matern(np.abs(grid[:, None] - grid[None, :]), length)
    spread = prior - weights @ cross.T + rest @ np.linalg.solve(information, rest.T)
    return weights + rest @ to_trend, spread
