"""Gaussian process regression of a distance over time, with correlated noise.

The function is a Matern process of smoothness 7/2 about a polynomial with a flat prior (Rasmussen
and Williams, "Gaussian Processes for Machine Learning", 2006, sections 2.2, 2.7, 4.2 and 5.4.1).
Length and amplitude of the process are not chosen but averaged over a grid, weighted by their
restricted marginal likelihood.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.analysis.jitter import Jitter
from app.geometry import FloatArray

LENGTHS_S = (0.04, 0.08, 0.16, 0.32, 0.64, 1.28)
AMPLITUDES = tuple(2.0**k for k in range(-2, 10))
"""Length scales, and amplitudes in standard deviations of the jitter, with equal prior weights."""
_MIN_WEIGHT = 2e-3


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
    for length in LENGTHS_S:
        kernel = _matern(lag, length)
        for index, scale in enumerate(AMPLITUDES):
            amplitude = scale * noise.sigma_mm
            if index == 0 or _acceleration(amplitude, length) <= max_acceleration_mm_s2:
                total = amplitude**2 * kernel + covariance
                fits.append((_evidence(total, trend, values_mm), length, amplitude**2))
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


def _evidence(covariance: FloatArray, trend: FloatArray, values: FloatArray) -> float:
    """Logarithm of the restricted likelihood, up to a constant (equation 2.45 of the book)."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, np.column_stack([values, trend]))
    data, basis = white[:, 0], white[:, 1:]
    information = basis.T @ basis
    projected = basis.T @ data
    quadratic = data @ data - projected @ np.linalg.solve(information, projected)
    log_det = 2.0 * np.log(np.diagonal(factor)).sum() + np.linalg.slogdet(information)[1]
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
