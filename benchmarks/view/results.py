"""From what a page saw to figures, and what is wanted of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST_PER_S = 10.0
LONGEST_P95_MS = 250.0
GROWTH_MS = 50.0
"""What the last quarter may be slower than the first: less than one picture takes."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One run of a page. ``growth_ms``: median delay of the last quarter less that of the first."""

    seconds: float
    pictures: int
    per_s: float
    delay_p50_ms: float
    delay_p95_ms: float
    delay_max_ms: float
    longest_gap_ms: float
    growth_ms: float


def figures(seen: list[list[float]], due_ms: list[float], seconds: float) -> Seen:
    """Of ``[frame, time in ms]`` for every picture, by when each frame was due."""
    frames, at_ms = np.array(seen).T
    delays = at_ms - np.array(due_ms)[frames.astype(int)]
    quarter = max(len(delays) // 4, 1)
    return Seen(
        seconds=seconds,
        pictures=len(frames),
        per_s=round(len(frames) / seconds, 2),
        delay_p50_ms=round(float(np.median(delays)), 1),
        delay_p95_ms=round(float(np.quantile(delays, 0.95)), 1),
        delay_max_ms=round(float(delays.max()), 1),
        longest_gap_ms=round(float(np.diff(at_ms).max(initial=0.0)), 1),
        growth_ms=round(float(np.median(delays[-quarter:]) - np.median(delays[:quarter])), 1),
    )


def failures(ours: Seen) -> list[str]:
    """What is not as wanted."""
    wrong = []
    if ours.per_s < LEAST_PER_S:
        wrong.append(f"{ours.per_s} pictures a second: {LEAST_PER_S} or more wanted")
    if ours.delay_p95_ms > LONGEST_P95_MS:
        wrong.append(f"p95 of the delay is {ours.delay_p95_ms} ms: {LONGEST_P95_MS} allowed")
    if ours.growth_ms > GROWTH_MS:
        wrong.append(f"the delay grew by {ours.growth_ms} ms: {GROWTH_MS} allowed")
    return wrong


def ratios(ours: Seen, peer: Seen) -> dict[str, Any]:
    """Ours over the peer's."""
    return {
        "per_s": round(ours.per_s / peer.per_s, 2),
        "delay_p50": round(ours.delay_p50_ms / peer.delay_p50_ms, 2),
        "delay_p95": round(ours.delay_p95_ms / peer.delay_p95_ms, 2),
    }
