"""Breaches of a case: when, where, by which part of the tool, how fast and how deep.

The depth has a confidence interval. The lowest of many noisy distances is too low: a minimum
selects the noise. Here the distance is a smooth function of time plus the jitter of the tracker,
with the autocorrelation that `estimate_jitter` finds, and the depth is the minimum of the function.

1. The distances around the breach are smoothed (`app.analysis.smoothing`). Only the time in which
   the smoothed distance is near its minimum is kept: the approach says little about the depth, and
   its steepness would make the function too rough at the minimum.
2. The rest is smoothed about a parabola, and functions are drawn from the posterior, also between
   the samples. The minima of the draws have the spread of the depth.
3. The estimate is the minimum of the posterior mean: draws wander below a flat minimum, so that
   their median is too deep. The interval reaches from the 2.5 to the 97.5 percentile of the draws
   about it.
4. A few samples near the minimum do not show how rough the function is between them: for ``n``
   samples the draws are spread from their median by ``sqrt(1 + 2 / n)``.

`tests/analysis/test_long_depth.py` and `test_correlated_depth.py` measure bias and coverage on
simulated breaches.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from app.analysis.samples import Breach, CaseSamples, find_breaches
from app.analysis.smoothing import Jitter, Smoothing, smooth
from app.geometry import FloatArray, InputError, anatomical_words
from app.session import is_tip, place_letters

DRAWS = 4000
MAX_SAMPLES = 200
"""A longer breach is evaluated in parts of this many samples."""
_OVERLAP = 20
GRID_PER_SAMPLE = 2
NEAR_SIGMAS = 3.0
"""Smoothed distances within this many standard deviations of the minimum are near it."""
MIN_NEAR = 9
"""Least number of samples that are kept near the minimum."""
MAX_ACCELERATION_MM_S2 = 2000.0
"""Largest standard deviation of the acceleration near the minimum, where the tool turns."""
FEW_SAMPLES = 2.0
"""The variance of the draws is larger by this over the number of samples near the minimum. Without
it, intervals of simulated breaches with known jitter hold the depth in 91 to 94 % at 20 Hz."""
_LOW, _HIGH = 2.5, 97.5
_ADDED = tuple(10.0**k for k in range(-9, 1))
PAD_S = 0.3
"""Samples this long before and after a breach are used for its depth."""
EDGE_S = 0.1
"""The lowest point is searched this long before the first and after the last inside frame, too:
jitter may hide it from a shallow breach. No further than half way to the next breach."""
ENTRY_S = (0.1, 0.05)
"""The speed at entry is that of the straight line through the distances from this long before the
first inside frame to this long after it: less after it, because a short plunge soon turns."""


@dataclass(frozen=True, slots=True)
class DepthEstimate:
    """The minimum of the true signed distance in a breach, in mm, negative inside.

    ``low_mm`` to ``high_mm`` is the 95 % interval. ``inside_probability``: the probability that the
    tool was in the tumour at all: that the minimum is negative. ``samples``: number of distances
    that were used.
    """

    distance_mm: float
    low_mm: float
    high_mm: float
    inside_probability: float
    samples: int

    @property
    def depth_mm(self) -> float:
        """The depth: 0 if the estimate is outside."""
        return max(0.0, -self.distance_mm)


def estimate_depth(
    times_s: FloatArray,
    distances_mm: FloatArray,
    jitter: Jitter,
    *,
    start_s: float,
    end_s: float,
    bias_sigma_mm: float = 0.0,
    seed: int = 0,
) -> DepthEstimate:
    """Estimate the lowest distance between ``start_s`` and ``end_s``.

    ``times_s`` (n,) increases and covers the interval and, where it is known, some time before and
    after it; ``distances_mm`` (n,) are the measured ones. ``bias_sigma_mm`` is the standard
    deviation of an error that is constant over the breach, of registration or calibration, which
    the samples cannot show: it widens the interval. The same ``seed`` gives the same result. Raises
    `InputError` for arrays of other shapes, for numbers that are not finite and without a sample.
    """
    times, values = _checked(times_s, distances_mm)
    if not start_s <= end_s:
        raise InputError(
            f"depth: from {start_s:g} s to {end_s:g} s; expected a start before the end"
        )
    if not (math.isfinite(bias_sigma_mm) and bias_sigma_mm >= 0.0):
        raise InputError(f"depth: bias_sigma_mm is {bias_sigma_mm:g}; expected 0 or more")
    random = np.random.default_rng(seed)
    lowest = np.full(DRAWS, np.inf)
    for first, last in _parts(times, start_s, end_s):
        begin, end = max(start_s, float(times[first])), min(end_s, float(times[last - 1]))
        used = slice(max(0, first - _OVERLAP), last + _OVERLAP)
        draws = _minimum_draws(times[used], values[used], jitter, begin, max(begin, end), random)
        lowest = np.minimum(lowest, draws)
    lowest = lowest + bias_sigma_mm * random.standard_normal(DRAWS)
    low, middle, high = np.percentile(lowest, (_LOW, 50.0, _HIGH)).tolist()
    return DepthEstimate(middle, low, high, float((lowest < 0.0).mean()), len(times))


def _checked(times_s: FloatArray, distances_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    times = np.asarray(times_s, dtype=np.float64)
    values = np.asarray(distances_mm, dtype=np.float64)
    if times.ndim != 1 or times.shape != values.shape or len(times) == 0:
        raise InputError(
            f"depth: times have shape {times.shape} and distances {values.shape}; "
            "expected (n,) for both, with n > 0"
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise InputError("depth: times or distances are not finite; expected finite numbers")
    if len(times) > 1 and np.diff(times).min() <= 0.0:
        raise InputError("depth: times do not increase; expected increasing times")
    return times, values


def _parts(times: FloatArray, start_s: float, end_s: float) -> list[tuple[int, int]]:
    """Ranges of samples that cover the interval, `MAX_SAMPLES` at most, with common ends."""
    if len(times) <= MAX_SAMPLES:
        return [(0, len(times))]
    first = min(int(np.searchsorted(times, start_s, side="left")), len(times) - 1)
    last = max(int(np.searchsorted(times, end_s, side="right")) - 1, first)
    count = max(1, math.ceil((last - first) / (MAX_SAMPLES - 2 * _OVERLAP)))
    edges = np.linspace(first, last, count + 1).round().astype(int).tolist()
    return [(a, b + 1) for a, b in pairwise(edges)]


def _minimum_draws(
    times: FloatArray,
    values: FloatArray,
    jitter: Jitter,
    start_s: float,
    end_s: float,
    random: np.random.Generator,
) -> FloatArray:
    """`DRAWS` draws of the minimum between ``start_s`` and ``end_s``, about its estimate."""
    grid = _grid(times, start_s, end_s)
    coarse = smooth(times, values, jitter, grid, degree=1).gain @ values
    near = grid[coarse <= coarse.min() + NEAR_SIGMAS * jitter.sigma_mm]
    used = _widened(times, float(near[0]), float(near[-1]))
    times, values = times[used], values[used]
    grid = grid[(grid >= near[0]) & (grid <= near[-1])]
    limit = MAX_ACCELERATION_MM_S2
    fine = smooth(times, values, jitter, grid, degree=2, max_acceleration_mm_s2=limit)
    draws = _posterior_minima(fine, random)
    estimate = float((fine.gain @ values).min())
    count = max(1, int(((times >= near[0]) & (times <= near[-1])).sum()))
    spread = math.sqrt(1.0 + FEW_SAMPLES / count)
    return np.asarray(estimate + spread * (draws - np.median(draws)))


def _grid(times: FloatArray, start_s: float, end_s: float) -> FloatArray:
    """The times of the samples in the interval and between them."""
    inside = times[(times > start_s) & (times < end_s)]
    ends = np.concatenate([[start_s], inside, [end_s]])
    pieces = [
        np.linspace(a, b, GRID_PER_SAMPLE, endpoint=False)
        for a, b in pairwise(ends.tolist())
        if b > a
    ]
    return np.concatenate([*pieces, [end_s]])


def _widened(times: FloatArray, start_s: float, end_s: float) -> slice:
    """The samples of the interval, and further ones on both sides up to `MIN_NEAR`."""
    first = int(np.searchsorted(times, start_s, side="left"))
    last = int(np.searchsorted(times, end_s, side="right"))
    missing = max(0, min(MIN_NEAR, len(times)) - (last - first))
    first = max(0, first - (missing + 1) // 2)
    last = min(len(times), max(last + missing // 2, first + MIN_NEAR))
    return slice(max(0, min(first, last - MIN_NEAR)), last)


def _posterior_minima(smoothing: Smoothing, random: np.random.Generator) -> FloatArray:
    """`DRAWS` draws of the minimum of the smoothed function, over all processes."""
    weights = np.array([weight for weight, _, _ in smoothing.parts])
    counts = np.floor(DRAWS * weights / weights.sum()).astype(int)
    counts[int(np.argmax(counts))] += DRAWS - int(counts.sum())
    minima = []
    for (_, mean, covariance), count in zip(smoothing.parts, counts.tolist(), strict=True):
        if count == 0:
            continue
        deviation = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        near = mean - 5.0 * deviation <= (mean + 5.0 * deviation).min()
        factor = _factor(covariance[np.ix_(near, near)])
        normal = random.standard_normal((count, len(factor)))
        minima.append((mean[near] + normal @ factor.T).min(axis=1))
    return np.asarray(random.permutation(np.concatenate(minima)))


def _factor(covariance: FloatArray) -> FloatArray:
    """Lower factor (m, m) of ``covariance``, in which rounding may leave a negative eigenvalue.

    As much is added to the diagonal as the factorisation needs, from 1e-9 of the largest variance
    (3e-5 of its standard deviation) to all of it. The covariance of a smooth function is nearly
    singular. Raises `LinAlgError` for a matrix that is no covariance.
    """
    largest = max(float(np.diagonal(covariance).max()), 1e-12)
    for share in _ADDED[:-1]:
        with suppress(np.linalg.LinAlgError):
            return _cholesky(covariance + share * largest * np.eye(len(covariance)))
    return _cholesky(covariance + _ADDED[-1] * largest * np.eye(len(covariance)))


def _cholesky(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class AnalysedBreach:
    """One breach. Lengths in mm, times in s from the first frame.

    ``lowest_sample_mm`` is the lowest measured distance, which jitter makes too low. ``estimate``
    is None for a breach that is between two frames only, or in a case without a known jitter.
    ``entry_speed_mm_s``: rate at which the distance falls at the entry, None if it is not known.
    ``direction`` and ``side`` name the place on the tumour, from its centroid, by the nearest of 26
    and of 6 directions (`place_letters`), empty if unknown; ``on_tumor_mm`` is that place in the
    tumour's frame. ``part``: ``tip``, ``shaft``, or empty.
    """

    start_s: float
    end_s: float
    frames: int
    lowest_sample_mm: float
    estimate: DepthEstimate | None
    entry_speed_mm_s: float | None
    direction: str
    side: str
    on_tumor_mm: tuple[float, float, float]
    part: str

    @property
    def duration_s(self) -> float:
        """From the first to the last inside frame: 0 for a breach of a single frame."""
        return self.end_s - self.start_s


def analyse_breaches(
    samples: CaseSamples,
    jitter: Jitter | None,
    *,
    stale_after_ns: int,
    centroid_mm: FloatArray,
    ras_from_tumor: FloatArray | None,
    bias_sigma_mm: float,
) -> tuple[AnalysedBreach, ...]:
    """The breaches of ``samples``, in the order of time.

    ``centroid_mm`` (3,) is the tumour's, ``ras_from_tumor`` as in `place_letters`,
    ``bias_sigma_mm`` as in `estimate_depth`.
    """
    found = find_breaches(samples.rows(), stale_after_ns)
    measured = samples.measured()
    times, distances = samples.times_s[measured], samples.distances_mm[measured]
    analysed = []
    for breach, (from_s, until_s) in zip(found, _search_limits(found), strict=True):
        near = (times >= breach.start_s - PAD_S) & (times <= breach.end_s + PAD_S)
        near_s = times[near]
        estimate = None
        if jitter is not None and ((near_s >= breach.start_s) & (near_s <= breach.end_s)).any():
            estimate = estimate_depth(
                near_s,
                distances[near],
                jitter,
                start_s=max(from_s, float(near_s[0])),
                end_s=min(until_s, float(near_s[-1])),
                bias_sigma_mm=bias_sigma_mm,
                seed=breach.first,
            )
        place_mm = samples.on_tumor_mm[breach.deepest]
        letters = place_letters(place_mm - centroid_mm, ras_from_tumor)
        x, y, z = place_mm.tolist()
        analysed.append(
            AnalysedBreach(
                breach.start_s,
                breach.end_s,
                breach.frames,
                breach.min_signed_distance_mm,
                estimate,
                _entry_speed(times, distances, breach.start_s),
                anatomical_words(letters),
                anatomical_words(letters[:1]),
                (x, y, z),
                _part(samples.on_tool_mm[breach.deepest]),
            )
        )
    return tuple(analysed)


def _search_limits(found: Sequence[Breach]) -> list[tuple[float, float]]:
    """From when to when, in s, the lowest point of each breach is searched.

    Jitter divides a breach whose depth is near to its standard deviation; each part has its depth.
    """
    half_way = [0.5 * (one.end_s + other.start_s) for one, other in pairwise(found)]
    bounds = [-math.inf, *half_way, math.inf]
    return [
        (max(breach.start_s - EDGE_S, bounds[k]), min(breach.end_s + EDGE_S, bounds[k + 1]))
        for k, breach in enumerate(found)
    ]


def _entry_speed(times: FloatArray, distances: FloatArray, start_s: float) -> float | None:
    """Slope at the entry, positive towards the tumour; None with fewer than three samples."""
    near = (times >= start_s - ENTRY_S[0]) & (times <= start_s + ENTRY_S[1])
    if near.sum() < 3:
        return None
    elapsed = times[near] - times[near].mean()
    return float(-(elapsed @ distances[near]) / (elapsed @ elapsed))


def _part(on_tool_mm: FloatArray) -> str:
    """``tip`` or ``shaft`` for a point (3,) in the tip's frame; empty if it is not known."""
    if not np.isfinite(on_tool_mm).all():
        return ""
    return "tip" if is_tip(float(np.linalg.norm(on_tool_mm))) else "shaft"


def sides_of(breaches: Sequence[AnalysedBreach]) -> dict[str, int]:
    """Number of breaches on each side of the tumour."""
    counts: dict[str, int] = {}
    for breach in breaches:
        counts[breach.side] = counts.get(breach.side, 0) + 1
    return dict(sorted(counts.items()))
