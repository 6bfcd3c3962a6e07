"""Probability of a breach, given errors that the measured distances cannot show.

Registration, pivot and contour displace the tool relative to the tumour by an error that is
constant over a case. To first order an error ``e`` changes the distance by ``n . e`` with the
normal ``n`` at the nearest point of the tumour, so at one moment the true distance is normal and
the probability of a breach has a closed form. Over a case the moments share their error: the
probability that any of them was inside is computed by Monte Carlo. All answers use the same
standard normal draws (common random numbers), so that their differences are due to the question,
not to chance. First order holds for errors that are small beside the tumour's radius of curvature.

The distances should be free of jitter, which is no constant error: `smoothed_distances`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError

DRAWS = 4000
_BLOCK = 500
SMOOTH_S = 0.2


@dataclass(frozen=True, slots=True)
class StopOutcome:
    """What an ideal fixture with the stop margin ``stop_mm`` would have done.

    It holds the measured distance at the margin or above. ``held_s``: time in which it had acted.
    ``probability``: of a breach in spite of it.
    """

    stop_mm: float
    held_s: float
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class BreachProbability:
    """``moments`` (n,): probability that the tool was inside at each moment, NaN where unknown.

    ``case``: that it ever was. ``without``: the same if one source of error had none; the
    difference is what the source contributes. ``stops``: what other stop margins had done.
    """

    moments: FloatArray
    case: float
    without: Mapping[str, float]
    stops: tuple[StopOutcome, ...]


def breach_probability(
    distances_mm: FloatArray,
    normals: FloatArray,
    held_s: FloatArray,
    covariances_mm2: Mapping[str, FloatArray],
    *,
    stops_mm: tuple[float, ...] = (),
    seed: int = 0,
) -> BreachProbability:
    """The probability of a breach of a case whose constant errors have ``covariances_mm2``.

    ``distances_mm`` (n,), ``normals`` (n, 3) and ``held_s`` (n,), the duration of each frame, are
    those of the case; frames with NaN are left out. ``covariances_mm2`` are (3, 3) by the name of
    the source, in the tumour's frame. Raises `InputError` for other shapes and for a matrix that is
    not symmetric and positive semidefinite.
    """
    if normals.shape != (len(distances_mm), 3) or held_s.shape != distances_mm.shape:
        raise InputError(
            f"breach probability: distances have shape {distances_mm.shape}, normals "
            f"{normals.shape} and durations {held_s.shape}; expected (n,), (n, 3) and (n,)"
        )
    roots = {name: _root(name, matrix) for name, matrix in covariances_mm2.items()}
    known = np.isfinite(distances_mm) & np.isfinite(normals).all(axis=1)
    distances, directions = distances_mm[known], normals[known]
    moments = np.full(len(distances_mm), np.nan)
    moments[known] = moment_probabilities(distances, directions, covariances_mm2)
    random = np.random.default_rng(seed)
    errors = {name: random.standard_normal((DRAWS, 3)) @ root.T for name, root in roots.items()}
    total = sum(errors.values(), np.zeros((DRAWS, 3)))
    stops = tuple(
        StopOutcome(
            stop,
            float(held_s[known][distances < stop].sum()),
            _share(np.maximum(distances, stop), directions, total),
        )
        for stop in stops_mm
    )
    without = {name: _share(distances, directions, total - each) for name, each in errors.items()}
    return BreachProbability(moments, _share(distances, directions, total), without, stops)


def moment_probabilities(
    distances_mm: FloatArray, normals: FloatArray, covariances_mm2: Mapping[str, FloatArray]
) -> FloatArray:
    """The closed form (n,): the normal distribution of each distance, below 0."""
    covariance = sum(covariances_mm2.values(), np.zeros((3, 3)))
    sigma = np.sqrt(np.einsum("ni,ij,nj->n", normals, covariance, normals))
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(sigma > 0.0, distances_mm / sigma, np.sign(distances_mm) * np.inf)
    scaled = np.where(np.isnan(scaled), 0.0, scaled)
    return np.array([0.5 * math.erfc(value / math.sqrt(2.0)) for value in scaled.tolist()])


def smoothed_distances(times_s: FloatArray, distances_mm: FloatArray) -> FloatArray:
    """Distances (n,) as the local straight line within `SMOOTH_S`, NaN where not known."""
    found = np.full(len(times_s), np.nan)
    known = np.flatnonzero(np.isfinite(distances_mm))
    times, values = times_s[known], distances_mm[known]
    order = np.maximum.accumulate(times) if len(times) else times
    first = np.searchsorted(order, times - 0.5 * SMOOTH_S, side="left")
    last = np.searchsorted(order, times + 0.5 * SMOOTH_S, side="right")
    for index, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        t, d = times[a:b] - times[index], values[a:b]
        spread = float(((t - t.mean()) ** 2).sum()) if b > a else 0.0
        slope = float((t - t.mean()) @ d) / spread if spread > 1e-12 else 0.0
        found[known[index]] = d.mean() - slope * t.mean() if b > a else values[index]
    return found


def _share(distances: FloatArray, normals: FloatArray, errors: FloatArray) -> float:
    """Share of the errors (k, 3) with which any distance is below 0."""
    if len(distances) == 0:
        return 0.0
    longest = float(np.linalg.norm(errors, axis=1).max())
    near = distances < longest
    if not near.any():
        return 0.0
    distances, normals = distances[near], normals[near]
    inside = 0
    for start in range(0, len(errors), _BLOCK):
        block = errors[start : start + _BLOCK]
        inside += int(((distances[:, None] + normals @ block.T).min(axis=0) < 0.0).sum())
    return inside / len(errors)


def _root(name: str, matrix: FloatArray) -> FloatArray:
    values = np.asarray(matrix, dtype=np.float64)
    if values.shape != (3, 3) or not np.isfinite(values).all():
        raise InputError(f"covariance of {name}: has shape {values.shape}; expected (3, 3), finite")
    eigenvalues, vectors = np.linalg.eigh(0.5 * (values + values.T))
    scale = max(float(np.abs(values).max()), 1e-12)
    if np.abs(values - values.T).max() > 1e-9 * scale or eigenvalues[0] < -1e-9 * scale:
        raise InputError(f"covariance of {name}: expected symmetric and positive semidefinite")
    return np.asarray(vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))
