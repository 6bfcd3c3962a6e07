"""Correlation of a noise over time, estimated from series in which a slow motion is removed.

The power of the noise is compared by octaves of frequency, as an Allan variance does it (Allan,
"Statistics of atomic frequency standards", 1966; IEEE Std 952). It is explained by white noise
beside processes of Gauss and Markov with one correlation time, or beside a flicker noise, which has
the same power in each octave: a sum of such processes whose correlation times are evenly spaced in
the logarithm (Keshner, "1/f noise", 1982). The models are averaged by their likelihood (Hoeting et
al., "Bayesian model averaging", 1999).

A series shows no frequency below that of the removed motion. There the models continue it: flat
below the corner of a single process, with constant power in each octave for flicker noise.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.geometry.errors import InputError
from app.geometry.transform import FloatArray

SHARES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
MAX_FREEDOM = 200.0
STARTS = 2
PRIOR = (0.3, 0.3, 0.4)
QUANTILE = 0.4


@dataclass(frozen=True, slots=True)
class Correlation:
    shares: tuple[float, ...] = ()
    times: tuple[float, ...] = ()

    def matrix(self, times: FloatArray) -> FloatArray:
        lag = np.abs(times[..., :, None] - times[..., None, :])
        total = sum(
            (share * np.exp(-lag / tau) for share, tau in zip(self.shares, self.times, strict=True)),
            np.zeros_like(lag),
        )
        diagonal = np.arange(times.shape[-1])
        total[..., diagonal, diagonal] = 1.0
        return np.asarray(total)


@dataclass(frozen=True, slots=True)
class Noise:
    variance: float
    correlation: Correlation


def _bands(first: int, count: int) -> list[tuple[int, int]]:
    edges = [first]
    while edges[-1] < count:
        edges.append(max(edges[-1] + 1, round(edges[-1] * 1.5)))
    edges[-1] = count
    if len(edges) > 2 and edges[-1] - edges[-2] < 0.25 * (edges[-2] - edges[-3]):
        del edges[-2]
    return list(zip(edges[:-1], edges[1:], strict=True))


def _cosines(count: int) -> FloatArray:
    k, i = np.arange(count)[:, None], np.arange(count)[None, :]
    return np.sqrt(2.0 / count) * np.cos(np.pi * k * (i + 0.5) / count)


def _residual_maker(times: FloatArray, degree: int) -> FloatArray:
    scaled = np.linspace(-1, 1, len(times)) if np.ptp(times) == 0 else 2 * (times - times[0]) / np.ptp(times) - 1
    q = np.linalg.qr(scaled[:, None] ** np.arange(degree + 1))[0]
    return np.eye(len(times)) - q @ q.T


@lru_cache(maxsize=32)
def _expected(count: int, degree: int, octaves: int) -> FloatArray:
    """(bands, 1 + octaves)"""
    index = np.arange(count, dtype=float)
    map_ = _cosines(count) @ _residual_maker(index, degree)
    bands = _bands(degree + 1, count)
    columns = []
    for k in range(-1, octaves):
        kernel = np.eye(count) if k < 0 else np.exp(-np.abs(index[:, None] - index) / (0.5 * 2.0**k))
        power = np.einsum("ki,ki->k", map_ @ kernel, map_)
        columns.append([power[a:b].mean() for a, b in bands])
    return np.array(columns).T


def estimate_noise(times: FloatArray, values: FloatArray, *, degree: int, longest: float, share: float = 1.0, still: bool = True) -> Noise:
    """times (n,) or (w, n), values (w, n)."""
    count = values.shape[1]
    period = float(np.median(np.diff(times, axis=-1)))
    off, motion = np.empty_like(values), np.empty(len(values))
    for w, v in enumerate(values):
        t = times if times.ndim == 1 else times[w]
        q = np.linalg.qr((2 * (t - t[0]) / np.ptp(t) - 1)[:, None] ** np.arange(degree + 1))[0]
        c = q.T @ v
        off[w] = v - q @ c
        motion[w] = (c[-2:] ** 2).sum()
    kept = motion <= 4.0 * np.quantile(motion, 0.25) if still else np.ones(len(values), bool)
    spectrum = (off[kept] @ _cosines(count).T) ** 2
    bands = _bands(degree + 1, count)
    octaves = max(1, 1 + int(np.floor(np.log2(max(longest / (0.5 * period), 1.0)))))
    observed = np.array([spectrum[:, a:b].mean() for a, b in bands])
    sizes = np.array([b - a for a, b in bands], dtype=float)
    freedom = np.minimum(share * kept.sum() * sizes, MAX_FREEDOM)
    observed = np.maximum(observed, 1e-9)
    expected = _expected(count, degree, octaves)
    corner = np.log2(count / (np.pi * (degree + 1)) / 0.5)
    models, priors = _models(octaves, float(corner))
    power = models @ expected.T  # (m, b)
    variance = (freedom * observed / power).sum(axis=1) / freedom.sum()
    scaled = observed / (variance[:, None] * power)
    fit = 0.5 * (freedom * (np.log(scaled) - scaled)).sum(axis=1)
    # log S = log obs - log scaled
    weight = priors * np.exp(fit - fit.max())
    weight /= weight.sum()
    total = weight * variance
    mean = float(total.sum())
    shares = (total @ models) / mean
    used = [(float(s), 0.5 * period * 2.0**k) for k, s in enumerate(shares[1:]) if s > 1e-4]
    return Noise(mean, Correlation(tuple(s for s, _ in used), tuple(t for _, t in used)))


DECAY = 0.3
def _models(octaves: int, corner: float) -> tuple[FloatArray, FloatArray]:
    rows, priors = [np.eye(1 + octaves)[0]], [PRIOR[0]]
    single = octaves * len(SHARES)
    for k in range(octaves):
        for share in SHARES:
            row = np.zeros(1 + octaves)
            row[0], row[1 + k] = 1 - share, share
            rows.append(row)
            priors.append(PRIOR[1] * DECAY ** max(0.0, k - corner) / len(SHARES) / min(octaves, max(corner, 1)))
    starts = range(0, min(octaves - 2, STARTS))
    for start in starts:
        for share in SHARES:
            row = np.zeros(1 + octaves)
            row[0] = 1 - share
            row[1 + start :] = share / (octaves - start)
            rows.append(row)
            priors.append(PRIOR[2] / (len(starts) * len(SHARES)))
    return np.array(rows), np.array(priors)
