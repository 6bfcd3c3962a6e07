"""Breaches of a case: when, where, by which part of the tool, how fast and how deep."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.analysis.breaches import Breach, find_breaches
from app.analysis.depth import DepthEstimate, estimate_depth
from app.analysis.jitter import Jitter
from app.analysis.samples import CaseSamples
from app.geometry import FloatArray, anatomical_words
from app.session import is_tip, place_letters

PAD_S = 0.3
"""Samples this long before and after a breach are used for its depth."""
EDGE_S = 0.1
"""The lowest point is searched this long before the first and after the last inside frame, too:
jitter may hide it from a shallow breach. No further than half way to the next breach."""
ENTRY_S = (0.1, 0.05)
"""The speed at entry is that of the straight line through the distances from this long before the
first inside frame to this long after it: less after it, because a short plunge soon turns."""


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
    times, measured = samples.times_s, samples.measured()
    limits = _search_limits(found)
    return tuple(
        _analysed(
            samples,
            times,
            measured,
            breach,
            limit,
            jitter,
            centroid_mm,
            ras_from_tumor,
            bias_sigma_mm,
        )
        for breach, limit in zip(found, limits, strict=True)
    )


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


def _analysed(
    samples: CaseSamples,
    times: FloatArray,
    measured: NDArray[np.intp],
    breach: Breach,
    limit_s: tuple[float, float],
    jitter: Jitter | None,
    centroid_mm: FloatArray,
    ras_from_tumor: FloatArray | None,
    bias_sigma_mm: float,
) -> AnalysedBreach:
    deepest = breach.deepest
    letters = place_letters(samples.on_tumor_mm[deepest] - centroid_mm, ras_from_tumor)
    x, y, z = samples.on_tumor_mm[deepest].tolist()
    near = measured[
        (times[measured] >= breach.start_s - PAD_S) & (times[measured] <= breach.end_s + PAD_S)
    ]
    inside = (times[near] >= breach.start_s) & (times[near] <= breach.end_s)
    estimate = None
    if jitter is not None and inside.any():
        estimate = estimate_depth(
            times[near],
            samples.distances_mm[near],
            jitter,
            start_s=max(limit_s[0], float(times[near[0]])),
            end_s=min(limit_s[1], float(times[near[-1]])),
            bias_sigma_mm=bias_sigma_mm,
            seed=breach.first,
        )
    return AnalysedBreach(
        breach.start_s,
        breach.end_s,
        breach.frames,
        breach.min_signed_distance_mm,
        estimate,
        _entry_speed(times[measured], samples.distances_mm[measured], breach.start_s),
        anatomical_words(letters),
        anatomical_words(letters[:1]),
        (x, y, z),
        _part(samples.on_tool_mm[deepest]),
    )


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
