"""Figures of a page, and the requirements on them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.harness.figures import at_least, at_most, missed, percentiles

MIN_PER_S = 10.0
MAX_P95_MS = 250.0
MAX_GROWTH_MS = 50.0
"""Largest growth of the delay from the first to the last quarter: less than one picture."""


@dataclass(frozen=True, slots=True)
class ViewFigures:
    """One run of a page. ``growth_ms``: median delay of the last quarter minus the first."""

    seconds: float
    pictures: int
    per_s: float
    delay_p50_ms: float
    delay_p95_ms: float
    delay_max_ms: float
    longest_gap_ms: float
    growth_ms: float


def figures(seen: list[list[float]], due_ms: list[float], seconds: float) -> ViewFigures:
    """Figures of ``[frame, time in ms]`` per picture, given the due time of each frame."""
    frames, at_ms = np.array(seen).T
    delays = at_ms - np.array(due_ms)[frames.astype(int)]
    p50, p95, largest = (round(each, 1) for each in percentiles(delays, 50, 95, 100))
    quarter = max(len(delays) // 4, 1)
    return ViewFigures(
        seconds=seconds,
        pictures=len(frames),
        per_s=round(len(frames) / seconds, 2),
        delay_p50_ms=p50,
        delay_p95_ms=p95,
        delay_max_ms=largest,
        longest_gap_ms=round(float(np.diff(at_ms).max(initial=0.0)), 1),
        growth_ms=round(float(np.median(delays[-quarter:]) - np.median(delays[:quarter])), 1),
    )


def failures(ours: ViewFigures) -> list[str]:
    return missed(
        (
            at_least("there are", ours.per_s, MIN_PER_S, "pictures a second"),
            at_most("p95 of the delay is", ours.delay_p95_ms, MAX_P95_MS, "ms"),
            at_most("the delay grew by", ours.growth_ms, MAX_GROWTH_MS, "ms"),
        )
    )


def ratios(ours: ViewFigures, peer: ViewFigures) -> dict[str, Any]:
    return {
        "per_s": round(ours.per_s / peer.per_s, 2),
        "delay_p50": round(ours.delay_p50_ms / peer.delay_p50_ms, 2),
        "delay_p95": round(ours.delay_p95_ms / peer.delay_p95_ms, 2),
    }
