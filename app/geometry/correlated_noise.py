"""Correlation of a noise over time, estimated from series whose motion is removed.

The power of the noise is compared in bands of frequency, as an Allan variance compares it over
durations (Allan, "Statistics of atomic frequency standards", 1966). It is explained by white noise
alone, beside a process of Gauss and Markov with one correlation time, or beside flicker noise,
which has the same power in every octave: a sum of such processes with correlation times that are
evenly spaced in the logarithm (Keshner, "1/f noise", 1982). The models are averaged by their
likelihood (Hoeting et al., "Bayesian model averaging", 1999).

No series shows frequencies below those of the removed motion. There the models continue the noise:
constant below the corner of a single process, inverse to the frequency for flicker noise, down to
the longest time that is given. A noise that rises otherwise at lower frequencies is not found.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from app.geometry.transform import FloatArray

MAX_SAMPLES = 250
"""Longest series that is evaluated as a whole; the effort grows with its square."""
_SHARES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
_WHITE, _SINGLE, _FLICKER = 0.2, 0.2, 0.6
"""Prior weights of the three kinds of noise."""
_LONGER = 0.15
"""Prior weight of a single process over that of one with half its correlation time, where its
corner is below the lowest frequency of the series: there both look the same."""
_MAX_FREEDOM = 200.0
"""Degrees of freedom of a band, at most: the models do not hold exactly."""
_BAND = 1.5
"""Ratio of the ends of a band."""
_LOWEST = 3
"""Half-waves that count as the lowest frequencies."""
_QUIET = 4.0
"""Quiet series have at most this multiple of the motion of the quietest quarter."""
_MIN_SHARE = 1e-4


@dataclass(frozen=True, slots=True)
class Correlation:
    """Autocorrelation ``sum_k shares[k] exp(-lag / times[k])`` beside white noise, the rest to 1.

    ``times`` are in the unit of the series.
    """

    shares: tuple[float, ...] = ()
    times: tuple[float, ...] = ()

    def matrix(self, times: FloatArray, others: FloatArray | None = None) -> FloatArray:
        """Correlation (n, m) of the noise at ``times`` (n,) with that at ``others`` (m,).

        ``others`` are by default the same times.
        """
        lag = np.abs(times[:, None] - (times if others is None else others)[None, :])
        total = (1.0 - sum(self.shares)) * (lag == 0.0)
        for share, time in zip(self.shares, self.times, strict=True):
            total += share * np.exp(-lag / time)
        return np.asarray(total)


def estimate_noise(
    times: FloatArray, values: FloatArray, *, degree: int, overlap: float, longest: float
) -> tuple[float, Correlation, int]:
    """Variance and correlation of the noise in series ``values`` (w, n) at ``times`` (w, n).

    A polynomial of ``degree`` is removed from each series as its motion. If it is 2 or more, only
    the quiet series are used: those with small coefficients of the two highest degrees, which the
    noise of the evaluated frequencies does not change. Their number is the third result.
    ``overlap`` (0 to 1] is the share of the samples that no other series repeats. The noise is
    continued to processes of correlation time ``longest``.
    """
    count = values.shape[1]
    period = float(np.median(np.diff(times, axis=1)))
    residuals, motion = np.empty_like(values), np.zeros(len(values))
    for row, series in enumerate(values):
        basis = _polynomials(times[row], degree)
        coefficients = basis.T @ series
        residuals[row] = series - basis @ coefficients
        motion[row] = float((coefficients[2:][-2:] ** 2).sum())
    quiet = motion <= _QUIET * np.quantile(motion, 0.25)
    bands = _bands(degree + 1, count)
    sizes = np.array([end - first for first, end in bands], dtype=np.float64)
    spectrum = (residuals[quiet] @ _cosines(count).T) ** 2
    floor = 1e-12 * float(spectrum.mean()) + 1e-300
    observed = np.array([spectrum[:, first:end].mean() for first, end in bands]) + floor
    freedom = np.minimum(overlap * quiet.sum() * sizes, _MAX_FREEDOM)
    octaves = max(3, 1 + int(np.floor(np.log2(max(longest / (0.5 * period), 1.0)))))
    corner = float(np.log2(2.0 * count / (np.pi * (degree + 1))))
    models, priors = _models(octaves, corner)
    power = models @ _band_power(count, degree, octaves).T
    variances = (freedom * observed / power).sum(axis=1) / freedom.sum()
    ratios = observed / (variances[:, None] * power)
    fits = 0.5 * (freedom * (np.log(ratios) - ratios)).sum(axis=1)
    weights = priors * np.exp(fits - fits.max())
    parts = (weights / weights.sum() * variances) @ models
    # The power at the lowest frequencies is known from few degrees of freedom: Student's
    # distribution.
    parts[1:] *= 1.0 + 2.0 / (overlap * quiet.sum() * _LOWEST)
    variance = float(parts.sum())
    kept = [k for k in range(octaves) if parts[1 + k] > _MIN_SHARE * variance]
    correlation = Correlation(
        tuple(float(parts[1 + k]) / variance for k in kept),
        tuple(0.5 * period * 2.0**k for k in kept),
    )
    return variance, correlation, int(quiet.sum())


def _polynomials(times: FloatArray, degree: int) -> FloatArray:
    scaled = 2.0 * (times - times[0]) / (times[-1] - times[0]) - 1.0
    return np.asarray(np.linalg.qr(scaled[:, None] ** np.arange(degree + 1))[0])


def _cosines(count: int) -> FloatArray:
    """Orthonormal cosine transform (n, n): row k has k half-waves."""
    rows, columns = np.arange(count)[:, None], np.arange(count)[None, :]
    return np.asarray(np.sqrt(2.0 / count) * np.cos(np.pi * rows * (columns + 0.5) / count))


def _bands(first: int, count: int) -> list[tuple[int, int]]:
    """Ranges of rows of `_cosines` without the motion's, each `_BAND` times as far as the last."""
    edges = [first]
    while edges[-1] < count:
        edges.append(max(edges[-1] + 1, round(_BAND * edges[-1])))
    edges[-1] = count
    if len(edges) > 2 and 4 * (edges[-1] - edges[-2]) < edges[-2] - edges[-3]:
        del edges[-2]
    return list(pairwise(edges))


@lru_cache(maxsize=32)
def _band_power(count: int, degree: int, octaves: int) -> FloatArray:
    """Expected power (bands, 1 + octaves) of white noise and of each process, with variance 1."""
    index = np.arange(count, dtype=np.float64)
    basis = _polynomials(index, degree)
    rows = _cosines(count)
    rows = rows - (rows @ basis) @ basis.T
    lag = np.abs(index[:, None] - index[None, :])
    powers = [np.einsum("ki,ki->k", rows, rows)]
    powers += [
        np.einsum("ki,ki->k", rows @ np.exp(-lag / (0.5 * 2.0**k)), rows) for k in range(octaves)
    ]
    bands = _bands(degree + 1, count)
    return np.array([[power[first:end].mean() for power in powers] for first, end in bands])


@lru_cache(maxsize=32)
def _models(octaves: int, corner: float) -> tuple[FloatArray, FloatArray]:
    """Shares (m, 1 + octaves) of white noise and the processes, and prior weights (m,)."""
    unit = np.eye(1 + octaves)
    singles = [
        (unit[1 + k], _SINGLE / octaves * _LONGER ** max(0.0, k - corner)) for k in range(octaves)
    ]
    flicker = (unit[1:].mean(axis=0), _FLICKER)
    rows, priors = [unit[0]], [_WHITE]
    for process, prior in [*singles, flicker]:
        for share in _SHARES:
            rows.append((1.0 - share) * unit[0] + share * process)
            priors.append(prior / len(_SHARES))
    return np.array(rows), np.array(priors)
