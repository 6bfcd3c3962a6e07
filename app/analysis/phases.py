"""Working phases by a rule: cutting, approach, away, unknown.

A frame belongs to the first phase whose condition holds:

- *unknown*: the distance is not known.
- *cutting*: the distance is at most the warning distance of the case, inside the tumour included.
- *approach*: the smoothed distance falls by at least `APPROACH_MM_S`.
- *away*: everything else.

The distance is smoothed over `WINDOW_S` for its slope. A run shorter than `MIN_RUN_S` is added to
the one before it. A jump back of the clock takes no time.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray

PHASES = ("unknown", "cutting", "approach", "away")
APPROACH_MM_S = 4.0
WINDOW_S = 0.4
MIN_RUN_S = 0.3


def phases_of(times_s: FloatArray, distances_mm: FloatArray, warn_mm: float) -> NDArray[np.int8]:
    """The phase of each frame, (n,), as an index of `PHASES`; unknown distances are NaN."""
    times_s = _rising(times_s)
    known = np.isfinite(distances_mm)
    phases = np.zeros(len(times_s), dtype=np.int8)
    phases[known] = 3
    phases[known & (_slopes(times_s, distances_mm) <= -APPROACH_MM_S)] = 2
    with np.errstate(invalid="ignore"):
        phases[known & (distances_mm <= warn_mm)] = 1
    return _without_short_runs(times_s, phases)


def phase_seconds(phases: NDArray[np.int8], held_s: FloatArray) -> Mapping[str, float]:
    """Time in each phase; ``held_s`` (n,) is the duration of each frame."""
    return {name: float(held_s[phases == k].sum()) for k, name in enumerate(PHASES)}


def phase_counts(phases: NDArray[np.int8]) -> Mapping[str, int]:
    """Number of runs of each phase."""
    starts = np.append(True, phases[1:] != phases[:-1])
    return {name: int((phases[starts] == k).sum()) for k, name in enumerate(PHASES)}


def _rising(times: FloatArray) -> FloatArray:
    """``times`` without the steps back: what follows one continues at the same time."""
    steps = np.diff(times)
    if not (steps < 0.0).any():
        return times
    return np.asarray(times[0] + np.append(0.0, np.cumsum(np.maximum(steps, 0.0))))


def _slopes(times: FloatArray, distances: FloatArray) -> FloatArray:
    """Slope of the straight line through the known distances within `WINDOW_S`, in mm/s."""
    slopes = np.zeros(len(times))
    known = np.flatnonzero(np.isfinite(distances))
    if len(known) < 3:
        return slopes
    t, d = times[known], distances[known]
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (np.ones(len(t)), t, d, t * t, t * d)]
    first = np.searchsorted(t, t - 0.5 * WINDOW_S, side="left")
    last = np.searchsorted(t, t + 0.5 * WINDOW_S, side="right")
    n, st, sd, stt, std = (total[last] - total[first] for total in sums)
    spread = n * stt - st * st
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (n * std - st * sd) / spread
    slopes[known] = np.where((n >= 3) & (spread > 1e-9), slope, 0.0)
    return slopes


def _without_short_runs(times: FloatArray, phases: NDArray[np.int8]) -> NDArray[np.int8]:
    joined = phases.copy()
    starts = np.flatnonzero(np.append(True, phases[1:] != phases[:-1])).tolist()
    for start, end in zip(starts, [*starts[1:], len(phases)], strict=True):
        until = times[end] if end < len(phases) else times[-1]
        if start > 0 and until - times[start] < MIN_RUN_S and phases[start] != 0:
            joined[start:end] = joined[start - 1]
    return joined
