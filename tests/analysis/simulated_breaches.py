"""Simulated breaches, whose true depth is the minimum of the motion in continuous time.

Each breach is a part of a record of 12 s of slow work near the tumour, from which the jitter is
estimated. The tool plunges, grazes or rests in the tumour with tremor, at 40 to 120 Hz with
irregular times. The jitter is white, or a stationary Gauss-Markov process, alone or beside white
noise.
"""

from dataclasses import dataclass

import numpy as np

from app.analysis import estimate_depth, estimate_jitter
from app.analysis.case_breaches import EDGE_S, PAD_S

RECORD_S = 12.0
JITTERS = {"white": (0.0, 0.02), "correlated": (1.0, 0.04), "mixed": (0.7, 0.08)}
"""Name -> share of correlated noise, its correlation time in s."""


@dataclass(frozen=True)
class SimulatedBreach:
    """A record with one breach: measured distances and the true minimum, in mm."""

    times_s: np.ndarray
    distances_mm: np.ndarray
    true_mm: float


def minimum_jerk(x: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def simulate(kind: str, seed: int) -> SimulatedBreach:
    """A record of `RECORD_S` with a breach in its middle."""
    random = np.random.default_rng([seed, sum(map(ord, kind))])
    rate = random.uniform(40.0, 120.0)
    count = int(RECORD_S * rate)
    times = np.sort((np.arange(count) + random.uniform(-0.2, 0.2, count)) / rate)
    fine = np.linspace(0.0, RECORD_S, 24001)
    truth = _motion(random)
    exact = truth(fine)
    share, tau = JITTERS[kind]
    sigma = random.uniform(0.1, 0.45)
    slow = random.standard_normal(count)
    for k in range(1, count):
        keep = np.exp(-(times[k] - times[k - 1]) / tau)
        slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * slow[k]
    noise = np.sqrt(1.0 - share) * random.standard_normal(count) + np.sqrt(share) * slow
    return SimulatedBreach(times, truth(times) + sigma * noise, float(exact.min()))


def _motion(random: np.random.Generator):
    """Distance in mm over time: slow work at 6 to 10 mm, and a breach at 6 s."""
    level, depth = random.uniform(6.0, 10.0), random.uniform(0.5, 6.0)
    swing, slow_hz = random.uniform(0.2, 1.5), random.uniform(0.1, 0.4)
    tremor, tremor_hz = random.uniform(0.0, 0.06), random.uniform(6.0, 10.0)
    wander, wander_hz = random.uniform(0.0, 0.4), random.uniform(0.5, 1.5)
    phases = random.uniform(0.0, 2.0 * np.pi, 3)
    shape = random.choice(["plunge", "graze", "rest"])
    fall_s, rise_s = random.uniform(0.25, 0.8, 2)
    hold_s = {"plunge": random.uniform(0.0, 0.3), "rest": random.uniform(0.5, 2.0)}.get(shape, 0.0)

    def distance(times: np.ndarray) -> np.ndarray:
        if shape == "graze":
            width = fall_s + rise_s
            dip = 1.0 / (1.0 + ((times - 6.0) / (0.5 * width)) ** 2) ** 2
        else:
            down = minimum_jerk((times - (6.0 - 0.5 * hold_s - fall_s)) / fall_s)
            up = minimum_jerk((times - (6.0 + 0.5 * hold_s)) / rise_s)
            dip = down - up
        work = level + swing * np.sin(2.0 * np.pi * slow_hz * times + phases[0])
        work += tremor * np.sin(2.0 * np.pi * tremor_hz * times + phases[1])
        work += wander * dip * np.sin(2.0 * np.pi * wander_hz * times + phases[2])
        return work - (level + depth) * dip

    return distance


def evaluate(breach: SimulatedBreach, seed: int) -> dict[str, float] | None:
    """Errors of the estimate and of the lowest sample; None for a breach that no sample shows."""
    inside = np.flatnonzero(breach.distances_mm < 0.0)
    jitter = estimate_jitter(breach.times_s, breach.distances_mm)
    if len(inside) == 0 or jitter is None:
        return None
    lowest = int(np.argmin(breach.distances_mm))
    runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    run = next(run for run in runs if run[0] <= lowest <= run[-1])
    start_s, end_s = float(breach.times_s[run[0]]), float(breach.times_s[run[-1]])
    near = (breach.times_s >= start_s - PAD_S) & (breach.times_s <= end_s + PAD_S)
    found = estimate_depth(
        breach.times_s[near],
        breach.distances_mm[near],
        jitter,
        start_s=start_s - EDGE_S,
        end_s=end_s + EDGE_S,
        seed=seed,
    )
    return {
        "error_mm": found.distance_mm - breach.true_mm,
        "lowest_error_mm": float(breach.distances_mm[lowest]) - breach.true_mm,
        "covered": float(found.low_mm <= breach.true_mm <= found.high_mm),
    }


@dataclass(frozen=True)
class DepthErrors:
    """Bias of the estimated depth and its standard error, coverage of the interval."""

    bias_mm: float
    standard_error_mm: float
    lowest_sample_bias_mm: float
    coverage: float

    @classmethod
    def over(cls, kind: str, count: int) -> "DepthErrors":
        """Errors over ``count`` breaches, of which a few are not seen by any sample."""
        found = [evaluate(simulate(kind, seed), seed) for seed in range(count)]
        rows = [row for row in found if row is not None]
        assert len(rows) > 0.9 * count
        errors = np.array([row["error_mm"] for row in rows])
        return cls(
            float(errors.mean()),
            float(errors.std() / np.sqrt(len(errors))),
            float(np.mean([row["lowest_error_mm"] for row in rows])),
            float(np.mean([row["covered"] for row in rows])),
        )
