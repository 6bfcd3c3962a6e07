"""Metrics of a needle's insertion by the definitions of Perk Tutor.

Perk Tutor (Ungi et al. 2012) sums the measured positions of the tip as they are, without smoothing,
and counts a step to the tissue if its end is inside the tissue's model. Gaps are not left out: a
step across a loss of the tracker counts with its whole time and length.
"""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError


@dataclass(frozen=True, slots=True)
class Insertion:
    """Times in s, lengths in mm, from the first to the last known tip.

    ``tissue_s`` and ``tissue_path_mm``: of the steps that end in the tissue.
    """

    elapsed_s: float
    path_mm: float
    tissue_s: float
    tissue_path_mm: float


def insertion_metrics(
    times_s: FloatArray, tips_mm: FloatArray, distances_mm: FloatArray
) -> Insertion:
    """The metrics of the tips (n, 3) at ``times_s`` (n,), in the tissue's frame.

    ``distances_mm`` (n,) are the signed distances to the tissue, negative inside. Frames with a NaN
    and those whose times do not increase are left out. Raises `InputError` for other shapes.
    """
    if tips_mm.shape != (len(times_s), 3) or distances_mm.shape != (len(times_s),):
        raise InputError(
            f"insertion: times have shape {times_s.shape}, tips {tips_mm.shape} and distances "
            f"{distances_mm.shape}; expected (n,), (n, 3) and (n,)"
        )
    known = np.isfinite(tips_mm).all(axis=1) & np.isfinite(distances_mm)
    times, tips, inside = times_s[known], tips_mm[known], distances_mm[known] < 0.0
    if len(times) < 2:
        return Insertion(0.0, 0.0, 0.0, 0.0)
    highest = np.append(-np.inf, np.maximum.accumulate(times)[:-1])
    later = times > highest
    times, tips, inside = times[later], tips[later], inside[later]
    seconds, lengths = np.diff(times), np.linalg.norm(np.diff(tips, axis=0), axis=1)
    return Insertion(
        float(seconds.sum()),
        float(lengths.sum()),
        float(seconds[inside[1:]].sum()),
        float(lengths[inside[1:]].sum()),
    )
