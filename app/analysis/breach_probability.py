"""Probability of a breach, given errors that the measured distances cannot show.

Registration, pivot and contour displace the tool relative to the tumour by an error that is
constant over a case. To first order an error ``e`` changes the distance by ``n . e`` with the
normal ``n`` at the nearest point of the tumour, so at one moment the true distance is normal and
the probability of a breach has a closed form. Over a case the moments share their error: the
probability that any of them was inside is computed by Monte Carlo. All answers use the same
standard normal draws (common random numbers), so that their differences are due to the question,
not to chance. The expected time inside is the sum of the closed forms. First order holds for errors
that are small beside the tumour's radius of curvature.

The distances should be free of jitter, which is no constant error: `smoothed_distances`.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from app.geometry import FloatArray, InputError

DRAWS = 4000
LISTED_PROBABILITY = 0.001
_BLOCK = 500
SMOOTH_S = 0.2


@dataclass(frozen=True, slots=True)
class Outcome:
    """Effect of the errors on a case.

    ``probability``: of a breach. ``inside_s``: expected time in the tumour. ``lowest_mm``: 5th,
    50th and 95th percentile of the lowest true distance, negative inside.
    """

    probability: float
    inside_s: float
    lowest_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SourceEffect:
    """Sensitivity to one source of error.

    ``without``: the outcome if it had none; ``doubled``: if its standard deviation was twice as
    large. ``variance_share``: its share, 0 to 1, of the variance of the lowest measured distance.
    """

    without: Outcome
    doubled: Outcome
    variance_share: float


@dataclass(frozen=True, slots=True)
class StopOutcome:
    """Outcome of a case with an ideal fixture that has the stop margin ``stop_mm``.

    It holds the measured distance at the margin or above. ``held_s``: time in which it had acted.
    ``outcome``: in spite of it.
    """

    stop_mm: float
    held_s: float
    outcome: Outcome


@dataclass(frozen=True, slots=True, eq=False)
class BreachProbability:
    """``distances_mm`` (n,): of the frames, as given. ``moments`` (n,): probability that the tool
    was inside at each moment, NaN where unknown.

    ``outcome``: of the case. ``sources``: sensitivity by the name of the source. ``stops``: what
    other stop margins had done.
    """

    distances_mm: FloatArray
    moments: FloatArray
    outcome: Outcome
    sources: Mapping[str, SourceEffect]
    stops: tuple[StopOutcome, ...]

    def as_dict(self, times_s: FloatArray) -> dict[str, Any]:
        """JSON types; ``times_s`` (n,): of the frames.

        ``moments`` are those with a probability of at least `LISTED_PROBABILITY`.
        """
        likely = np.flatnonzero(np.nan_to_num(self.moments) >= LISTED_PROBABILITY)
        return {
            "outcome": asdict(self.outcome),
            "sources": {name: asdict(effect) for name, effect in self.sources.items()},
            "stops": [asdict(stop) for stop in self.stops],
            "moments": {
                "t_s": times_s[likely].round(6).tolist(),
                "probability": self.moments[likely].round(6).tolist(),
            },
        }


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
    the source, in the tumour's frame. Raises `InputError` for other shapes, without a known frame,
    and for a matrix that is not symmetric and positive semidefinite.
    """
    if normals.shape != (len(distances_mm), 3) or held_s.shape != distances_mm.shape:
        raise InputError(
            f"breach probability: distances have shape {distances_mm.shape}, normals "
            f"{normals.shape} and durations {held_s.shape}; expected (n,), (n, 3) and (n,)"
        )
    roots = {name: _root(name, matrix) for name, matrix in covariances_mm2.items()}
    known = np.isfinite(distances_mm) & np.isfinite(normals).all(axis=1)
    if not known.any():
        raise InputError("breach probability: no frame has a distance; expected at least 1")
    case = _Moments(distances_mm[known], normals[known], held_s[known])
    random = np.random.default_rng(seed)
    errors = {name: random.standard_normal((DRAWS, 3)) @ root.T for name, root in roots.items()}
    total = sum(errors.values(), np.zeros((DRAWS, 3)))
    covariance = sum(covariances_mm2.values(), np.zeros((3, 3)))
    towards = case.normals[int(np.argmin(case.distances_mm))]
    variance = float(towards @ covariance @ towards)
    moments = np.full(len(distances_mm), np.nan)
    moments[known] = case.probabilities(covariance)
    return BreachProbability(
        distances_mm,
        moments,
        case.outcome(total, covariance),
        {
            name: SourceEffect(
                case.outcome(total - each, covariance - matrix),
                case.outcome(total + each, covariance + 3.0 * matrix),
                float(towards @ matrix @ towards) / variance if variance > 0.0 else 0.0,
            )
            for (name, each), matrix in zip(errors.items(), covariances_mm2.values(), strict=True)
        },
        tuple(
            StopOutcome(
                stop,
                float(case.held_s[case.distances_mm < stop].sum()),
                case.held_at(stop).outcome(total, covariance),
            )
            for stop in stops_mm
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Moments:
    """The known frames of a case: distances (n,), normals (n, 3) and durations (n,)."""

    distances_mm: FloatArray
    normals: FloatArray
    held_s: FloatArray

    def held_at(self, stop_mm: float) -> "_Moments":
        return _Moments(np.maximum(self.distances_mm, stop_mm), self.normals, self.held_s)

    def probabilities(self, covariance: FloatArray) -> FloatArray:
        return moment_probabilities(self.distances_mm, self.normals, {"all": covariance})

    def outcome(self, errors: FloatArray, covariance: FloatArray) -> Outcome:
        """The outcome of ``errors`` (k, 3), whose sum of sources has ``covariance``."""
        lowest = self._lowest(errors)
        low, middle, high = np.percentile(lowest, (5.0, 50.0, 95.0)).tolist()
        return Outcome(
            float((lowest < 0.0).mean()),
            float(self.probabilities(covariance) @ self.held_s),
            (low, middle, high),
        )

    def _lowest(self, errors: FloatArray) -> FloatArray:
        """The lowest distance with each of the errors, (k,)."""
        reach = 2.0 * float(np.linalg.norm(errors, axis=1).max(initial=0.0))
        near = self.distances_mm <= self.distances_mm.min() + reach
        distances, normals = self.distances_mm[near], self.normals[near]
        blocks = [errors[at : at + _BLOCK] for at in range(0, len(errors), _BLOCK)]
        return np.concatenate(
            [(distances[:, None] + normals @ block.T).min(axis=0) for block in blocks]
        )


def moment_probabilities(
    distances_mm: FloatArray, normals: FloatArray, covariances_mm2: Mapping[str, FloatArray]
) -> FloatArray:
    """The closed form (n,): the normal distribution of each distance, below 0."""
    covariance = sum(covariances_mm2.values(), np.zeros((3, 3)))
    variance = np.einsum("ni,ij,nj->n", normals, covariance, normals)
    sigma = np.sqrt(np.maximum(variance, 0.0))
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


def _root(name: str, matrix: FloatArray) -> FloatArray:
    values = np.asarray(matrix, dtype=np.float64)
    if values.shape != (3, 3) or not np.isfinite(values).all():
        raise InputError(f"covariance of {name}: has shape {values.shape}; expected (3, 3), finite")
    eigenvalues, vectors = np.linalg.eigh(0.5 * (values + values.T))
    scale = max(float(np.abs(values).max()), 1e-12)
    if np.abs(values - values.T).max() > 1e-9 * scale or eigenvalues[0] < -1e-9 * scale:
        raise InputError(f"covariance of {name}: expected symmetric and positive semidefinite")
    return np.asarray(vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))
