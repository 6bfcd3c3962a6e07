"""Metrics of a needle's insertion by the definitions of Perk Tutor.

Perk Tutor (Ungi et al. 2012) sums the measured positions of the tip as they are, without smoothing,
and counts a step to the tissue if its end is inside the tissue's model. Gaps are not left out: a
step across a loss of the tracker counts with its whole time and length.
"""

from dataclasses import dataclass

import numpy as np

from app.analysis.samples import CaseSamples
from app.analysis.tissue_damage import tissue_damage_mm2
from app.geometry import FloatArray, InputError, SurfaceMesh


@dataclass(frozen=True, slots=True)
class Insertion:
    """Times in s, lengths in mm, from the first to the last known tip.

    ``tissue_s`` and ``tissue_path_mm``: of the steps that end in the tissue. ``tissue_damage_mm2``:
    the area of `tissue_damage_mm2`, None where it was not asked for.
    """

    elapsed_s: float
    path_mm: float
    tissue_s: float
    tissue_path_mm: float
    tissue_damage_mm2: float | None = None


def case_insertion(samples: CaseSamples, tumor: SurfaceMesh) -> Insertion:
    """The metrics of a case, whose tissue is the surface ``tumor``, with the tissue damage."""
    return insertion_metrics(
        samples.times_s,
        samples.tips_mm,
        samples.distances_mm,
        rotations=samples.rotations,
        tissue=tumor,
    )


def insertion_metrics(
    times_s: FloatArray,
    tips_mm: FloatArray,
    distances_mm: FloatArray,
    *,
    rotations: FloatArray | None = None,
    tissue: SurfaceMesh | None = None,
) -> Insertion:
    """The metrics of the tips (n, 3) at ``times_s`` (n,), in the tissue's frame.

    ``distances_mm`` (n,) are the signed distances to the tissue, negative inside. Frames with a NaN
    and those whose times do not increase are left out. ``rotations`` (n, 3, 3) of the tool and the
    surface ``tissue`` add the tissue damage. Raises `InputError` for other shapes.
    """
    if tips_mm.shape != (len(times_s), 3) or distances_mm.shape != (len(times_s),):
        raise InputError(
            f"insertion: times have shape {times_s.shape}, tips {tips_mm.shape} and distances "
            f"{distances_mm.shape}; expected (n,), (n, 3) and (n,)"
        )
    if rotations is not None and rotations.shape != (len(times_s), 3, 3):
        raise InputError(
            f"insertion: rotations have shape {rotations.shape}; expected {(len(times_s), 3, 3)}"
        )
    known = np.isfinite(tips_mm).all(axis=1) & np.isfinite(distances_mm)
    frames = np.flatnonzero(known)
    highest = np.append(-np.inf, np.maximum.accumulate(times_s[frames])[:-1])
    frames = frames[times_s[frames] > highest[: len(frames)]]
    times, tips, inside = times_s[frames], tips_mm[frames], distances_mm[frames] < 0.0
    damage = None
    if rotations is not None and tissue is not None:
        damage = tissue_damage_mm2(tips, rotations[frames], inside, tissue)
    seconds, lengths = np.diff(times), np.linalg.norm(np.diff(tips, axis=0), axis=1)
    return Insertion(
        float(seconds.sum()),
        float(lengths.sum()),
        float(seconds[inside[1:]].sum()),
        float(lengths[inside[1:]].sum()),
        damage,
    )
