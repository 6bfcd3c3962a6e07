"""Figures of a page, and the requirements on them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

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
    quarter = max(len(delays) // 4, 1)
    return ViewFigures(
        seconds=seconds,
        pictures=len(frames),
        per_s=round(len(frames) / seconds, 2),
        delay_p50_ms=round(float(np.median(delays)), 1),
        delay_p95_ms=round(float(np.quantile(delays, 0.95)), 1),
        delay_max_ms=round(float(delays.max()), 1),
        longest_gap_ms=round(float(np.diff(at_ms).max(initial=0.0)), 1),
        growth_ms=round(float(np.median(delays[-quarter:]) - np.median(delays[:quarter])), 1),
    )


def failures(ours: ViewFigures) -> list[str]:
    """Missed requirements, one sentence each."""
    wrong = []
    if ours.per_s < MIN_PER_S:
        wrong.append(f"{ours.per_s} pictures a second; expected {MIN_PER_S} or more")
    if ours.delay_p95_ms > MAX_P95_MS:
        wrong.append(f"p95 of the delay is {ours.delay_p95_ms} ms; expected at most {MAX_P95_MS}")
    if ours.growth_ms > MAX_GROWTH_MS:
        wrong.append(f"the delay grew by {ours.growth_ms} ms; expected at most {MAX_GROWTH_MS}")
    return wrong


def ratios(ours: ViewFigures, peer: ViewFigures) -> dict[str, Any]:
    """Ratios of ours to the peer."""
    return {
        "per_s": round(ours.per_s / peer.per_s, 2),
        "delay_p50": round(ours.delay_p50_ms / peer.delay_p50_ms, 2),
        "delay_p95": round(ours.delay_p95_ms / peer.delay_p95_ms, 2),
    }
