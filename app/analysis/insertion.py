"""Metrics of a needle's insertion by the definitions of Perk Tutor.

Perk Tutor (Ungi et al. 2012) sums the measured positions of the tip as they are, without smoothing,
and counts a step to the tissue if the tip is inside the tissue's model at its end, wherever the
rest of the tool is. Gaps are not left out: a step across a loss of the tracker counts with its
whole time and length.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.samples import CaseSamples
from app.analysis.tissue_damage import tissue_damage_mm2
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import FloatArray, InputError, SurfaceMesh


@dataclass(frozen=True, slots=True)
class Insertion:
    """Times in s, lengths in mm, from the first to the last known tip.

    ``tissue_s`` and ``tissue_path_mm``: of the steps that end with the tip in the tissue.
    ``tissue_damage_mm2``: the area of `tissue_damage_mm2`, None where it was not asked for.
    """

    elapsed_s: float
    path_mm: float
    tissue_s: float
    tissue_path_mm: float
    tissue_damage_mm2: float | None = None


def case_insertion(samples: CaseSamples, tumor: SurfaceMesh) -> Insertion:
    """The metrics of a case, whose tissue is the surface ``tumor``, with the tissue damage.

    Frames without a distance are left out: their pose is not known to be good.
    """
    known = np.isfinite(samples.distances_mm)
    return insertion_metrics(
        samples.times_s[known],
        samples.tips_mm[known],
        tumor,
        rotations=samples.rotations[known],
    )


def insertion_metrics(
    times_s: FloatArray,
    tips_mm: FloatArray,
    tissue: SurfaceMesh,
    *,
    rotations: FloatArray | None = None,
) -> Insertion:
    """The metrics of the tips (n, 3) at ``times_s`` (n,), in the frame of the closed ``tissue``.

    Frames with a NaN and those whose times do not increase are left out. ``rotations`` (n, 3, 3) of
    the tool add the tissue damage. Raises `InputError` for other shapes.
    """
    if tips_mm.shape != (len(times_s), 3):
        raise InputError(
            f"insertion: times have shape {times_s.shape} and tips {tips_mm.shape}; "
            "expected (n,) and (n, 3)"
        )
    if rotations is not None and rotations.shape != (len(times_s), 3, 3):
        raise InputError(
            f"insertion: rotations have shape {rotations.shape}; expected {(len(times_s), 3, 3)}"
        )
    frames = np.flatnonzero(np.isfinite(tips_mm).all(axis=1))
    highest = np.append(-np.inf, np.maximum.accumulate(times_s[frames])[:-1])
    frames = frames[times_s[frames] > highest[: len(frames)]]
    times, tips = times_s[frames], tips_mm[frames]
    inside = tips_inside(tips, tissue)
    damage = None
    if rotations is not None:
        damage = tissue_damage_mm2(tips, rotations[frames], inside, tissue)
    seconds, lengths = np.diff(times), np.linalg.norm(np.diff(tips, axis=0), axis=1)
    return Insertion(
        float(seconds.sum()),
        float(lengths.sum()),
        float(seconds[inside[1:]].sum()),
        float(lengths[inside[1:]].sum()),
        damage,
    )


def tips_inside(tips_mm: FloatArray, tissue: SurfaceMesh) -> NDArray[np.bool_]:
    """True for each of ``tips_mm`` (n, 3) that is inside the closed ``tissue``."""
    low, high = tissue.bounds_mm
    near = np.flatnonzero(((tips_mm >= low) & (tips_mm <= high)).all(axis=1))
    inside = np.zeros(len(tips_mm), dtype=bool)
    if len(near):
        dipoles = dipoles_of(indexed_bvh(tissue.vertices_mm, tissue.faces))
        inside[near] = winding_numbers(dipoles, tips_mm[near]) > 0
    return inside
