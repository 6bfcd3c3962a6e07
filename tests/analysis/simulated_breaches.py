"""Simulated breaches, whose true depth is the minimum of the motion in continuous time.

Each breach is a part of a record of 12 s of slow work near the tumour, from which the jitter is
estimated. The tool plunges, grazes or rests in the tumour with tremor, at irregular times. The
jitter is white; a stationary Gauss-Markov process, alone or beside white noise; pink; or recorded:
the residuals of a stylus at rest in the shipped phantom recording.
"""

from dataclasses import dataclass

import numpy as np

from app.analysis import Jitter, estimate_depth, estimate_jitter
from app.analysis.case_breaches import EDGE_S, PAD_S
from tests.synthetic.recorded_statistics import EIGHT, rests_of

RECORD_S = 12.0
JITTERS = {
    "white": (0.0, 0.02),
    "correlated": (1.0, 0.04),
    "slow": (1.0, 0.08),
    "mixed": (0.7, 0.08),
}
"""Name -> share of correlated noise, its correlation time in s."""
RECORDED_HZ = 15.0
_STARTS = 6
"""Samples at the ends of a recorded rest in which the stylus may move."""


@dataclass(frozen=True)
class KnownJitter:
    """The jitter of a record as `estimate_depth` takes it, with its true autocorrelation."""

    sigma_mm: float
    lags_s: np.ndarray
    correlation: np.ndarray

    def covariance(self, times_s: np.ndarray) -> np.ndarray:
        lag = np.abs(times_s[:, None] - times_s[None, :])
        # Times are irregular: the table is interpolated, which needs a little white noise.
        shape = np.interp(lag, self.lags_s, self.correlation) + 1e-3 * np.eye(len(times_s))
        return self.sigma_mm**2 * shape


@dataclass(frozen=True)
class SimulatedBreach:
    """A record with one breach: measured distances and the true minimum, in mm.

    ``jitter`` is the true one, None for a recorded one.
    """

    times_s: np.ndarray
    distances_mm: np.ndarray
    true_mm: float
    jitter: Jitter | KnownJitter | None


def minimum_jerk(x: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def simulate(kind: str, seed: int, rate_hz: float | None = None) -> SimulatedBreach:
    """A record of `RECORD_S` with a breach in its middle, by default at 40 to 120 Hz."""
    random = np.random.default_rng([seed, sum(map(ord, kind)), int(rate_hz or 0)])
    rate = rate_hz or random.uniform(40.0, 120.0)
    count = int(RECORD_S * rate)
    times = np.sort((np.arange(count) + random.uniform(-0.2, 0.2, count)) / rate)
    fine = np.linspace(0.0, RECORD_S, 24001)
    truth = _motion(random)
    exact = truth(fine)
    sigma = random.uniform(0.1, 0.45)
    jitter: Jitter | KnownJitter | None = None
    if kind == "pink":
        noise, correlation = _pink(random, count)
        jitter = KnownJitter(sigma, np.arange(count) / rate, correlation)
    elif kind == "recorded":
        noise = _recorded(random, times)
    else:
        share, tau = JITTERS[kind]
        slow = random.standard_normal(count)
        for k in range(1, count):
            keep = np.exp(-(times[k] - times[k - 1]) / tau)
            slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * slow[k]
        noise = np.sqrt(1.0 - share) * random.standard_normal(count) + np.sqrt(share) * slow
        jitter = Jitter(sigma, share, tau)
    return SimulatedBreach(times, truth(times) + sigma * noise, float(exact.min()), jitter)


def _pink(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise whose power is inverse to the frequency, from 1/`RECORD_S`, and its correlation."""
    power = np.append(0.0, 1.0 / np.arange(1, count // 2 + 1))
    correlation = np.fft.irfft(power, count)
    phases = random.standard_normal(len(power)) + 1j * random.standard_normal(len(power))
    noise = np.fft.irfft(np.sqrt(0.5 * count * power / correlation[0]) * phases, count)
    return noise, correlation / correlation[0]


def _recorded(random: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Residuals of rests, along random directions one after the other, at ``times`` (n,)."""
    rests = [
        rest[_STARTS:-_STARTS] for rest in rests_of(EIGHT, "Stylus") if len(rest) > 4 * _STARTS
    ]
    needed, parts = int((times[-1] + 1.0) * RECORDED_HZ), []
    while sum(map(len, parts)) < needed:
        direction = random.standard_normal(3)
        part = rests[random.integers(len(rests))] @ (direction / np.linalg.norm(direction))
        parts.append(random.choice([-1.0, 1.0]) * part / part.std())
    joined = np.concatenate(parts)
    return np.interp(times, np.arange(len(joined)) / RECORDED_HZ, joined)


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
    """Errors of the estimate and of the lowest sample; None for a breach that no sample shows.

    ``known_half_mm``: half-width of the interval by an estimate that knows the jitter.
    """
    inside = np.flatnonzero(breach.distances_mm < 0.0)
    jitter = estimate_jitter(breach.times_s, breach.distances_mm)
    if len(inside) == 0 or jitter is None:
        return None
    lowest = int(np.argmin(breach.distances_mm))
    runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    run = next(run for run in runs if run[0] <= lowest <= run[-1])
    start_s, end_s = float(breach.times_s[run[0]]), float(breach.times_s[run[-1]])
    near = (breach.times_s >= start_s - PAD_S) & (breach.times_s <= end_s + PAD_S)
    found, known = (
        estimate_depth(
            breach.times_s[near],
            breach.distances_mm[near],
            each,
            start_s=start_s - EDGE_S,
            end_s=end_s + EDGE_S,
            seed=seed,
        )
        for each in (jitter, breach.jitter or jitter)
    )
    return {
        "error_mm": found.distance_mm - breach.true_mm,
        "lowest_error_mm": float(breach.distances_mm[lowest]) - breach.true_mm,
        "covered": float(found.low_mm <= breach.true_mm <= found.high_mm),
        "half_mm": 0.5 * (found.high_mm - found.low_mm),
        "known_half_mm": 0.5 * (known.high_mm - known.low_mm),
    }


@dataclass(frozen=True)
class DepthErrors:
    """Bias of the estimated depth and its standard error, coverage of the interval.

    ``width_ratio``: mean width over that of an estimate that knows the jitter.
    """

    bias_mm: float
    standard_error_mm: float
    lowest_sample_bias_mm: float
    coverage: float
    width_ratio: float

    @classmethod
    def over(cls, kind: str, count: int, rate_hz: float | None = None) -> "DepthErrors":
        """Errors over ``count`` breaches, of which a few are not seen by any sample."""
        found = [evaluate(simulate(kind, seed, rate_hz), seed) for seed in range(count)]
        rows = [row for row in found if row is not None]
        assert len(rows) > 0.9 * count
        mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
        errors = np.array([row["error_mm"] for row in rows])
        return cls(
            mean["error_mm"],
            float(errors.std() / np.sqrt(len(errors))),
            mean["lowest_error_mm"],
            mean["covered"],
            mean["half_mm"] / mean["known_half_mm"],
        )
