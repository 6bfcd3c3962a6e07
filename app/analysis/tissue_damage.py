"""Area that a needle sweeps in the tissue, by the definition of Perk Tutor.

Between two frames with the tip in the tissue, the needle sweeps the quadrilateral of both tips and
both entry points: where the needle's axis, from the tip backwards, first leaves the tissue. Its
area is that of two triangles. A needle that moves along its axis sweeps nothing.
"""

import numpy as np
from numpy.typing import NDArray

from app.analysis.ray_casting import first_crossings
from app.geometry import FloatArray, SurfaceMesh

FORWARD = (0.0, 0.0, 1.0)
"""The needle's axis in the frame of its tip, by the convention of a case: +z forward."""


def tissue_damage_mm2(
    tips_mm: FloatArray, rotations: FloatArray, in_tissue: NDArray[np.bool_], tissue: SurfaceMesh
) -> float:
    """The area in mm2 that the needle sweeps in ``tissue``, a closed surface.

    ``tips_mm`` (n, 3) and ``rotations`` (n, 3, 3) are its poses in the frame of ``tissue``, in the
    order of time. Frames outside of ``in_tissue`` (n,) do not count, nor those whose tip is outside
    although another part of the tool is in the tissue.
    """
    frames = np.flatnonzero(in_tissue)
    tips = tips_mm[frames]
    backward = -rotations[frames] @ np.array(FORWARD)
    found = first_crossings(tissue, tips, backward)
    inside = found.leaves & np.isfinite(found.distances_mm)
    pairs = np.flatnonzero(inside[1:] & inside[:-1] & (np.diff(frames) == 1))
    with np.errstate(invalid="ignore"):
        entries = tips + found.distances_mm[:, None] * backward
    before, after = tips[pairs], tips[pairs + 1]
    entry_before, entry_after = entries[pairs], entries[pairs + 1]
    areas = _areas(before, after, entry_after) + _areas(entry_after, entry_before, before)
    return float(areas.sum())


def _areas(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Areas (n,) of triangles with these corners (n, 3)."""
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
