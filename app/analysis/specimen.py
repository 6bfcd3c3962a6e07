"""Resected specimen: what the swept volume separates around the tumour, and its closest margins.

The poses are smoothed as in `app.analysis.motion`. The specimen is the part of space around the
tumour that the swept volume closes off from the rest. Where the sweep leaves a gap, no specimen is
separated and none is invented: the tissue, skin and earlier cuts that may complete it are not in a
recording.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.analysis.coverage import SIDES, near_frames, sides_of_surface, surface_places
from app.analysis.motion import smoothed_path
from app.analysis.samples import CaseSamples
from app.analysis.swept_volume import (
    CUTTING_MM,
    SweptVolume,
    cutting_points,
    solid_of,
    surface_of,
    swept_volume,
)
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import ANATOMICAL_WORDS, FloatArray, MeshError, SurfaceMesh

MAX_POINTS = 2000
"""Places on the tumour's surface whose distance is a margin."""
TUMOR_MM = 0.005
"""The tumour's surface is simplified by at most this for the volumes."""
NEAR_MM = 10.0
"""Poses with the tool farther from the tumour than this are not taken as cutting."""


@dataclass(frozen=True, slots=True, eq=False)
class Specimen:
    """``solid``: a `manifold3d.Manifold` in the tumour's frame, ``surface`` the same as a mesh.

    ``margins_mm``: by the letter of each of the six sides of the tumour, the least distance from
    the tumour's surface on this side to the specimen's surface; negative where the tumour was cut.
    ``tumor_outside_mm3``: volume of the tumour that is not in the specimen.
    """

    solid: Any
    surface: SurfaceMesh
    volume_mm3: float
    tumor_outside_mm3: float
    margins_mm: Mapping[str, float]

    @property
    def closest(self) -> str:
        """Letter of the side with the least margin."""
        return min(self.margins_mm, key=lambda side: self.margins_mm[side])


@dataclass(frozen=True, slots=True, eq=False)
class Resection:
    """Tissue near the tumour that was cut by the cutting part within ``cutting_mm`` of the tip.

    ``swept`` is None where nothing was swept; ``why`` says why there is no ``specimen``, empty
    where there is one. ``tumor_cut_mm3``: volume of the tumour that was swept.
    """

    cutting_mm: float
    swept: SweptVolume | None
    tumor_cut_mm3: float
    specimen: Specimen | None
    why: str

    def as_dict(self) -> dict[str, Any]:
        """JSON types; unknown values are None."""
        swept, found = self.swept, self.specimen
        return {
            "cutting_mm": self.cutting_mm,
            "near_mm": NEAR_MM,
            "swept_mm3": None if swept is None else swept.volume_mm3,
            "poses": 0 if swept is None else swept.poses,
            "hulls": 0 if swept is None else swept.hulls,
            "tolerance_mm": None if swept is None else swept.tolerance_mm,
            "tumor_cut_mm3": self.tumor_cut_mm3,
            "specimen_mm3": None if found is None else found.volume_mm3,
            "tumor_outside_mm3": None if found is None else found.tumor_outside_mm3,
            "margins_mm": None
            if found is None
            else {ANATOMICAL_WORDS[side]: v for side, v in found.margins_mm.items()},
            "no_specimen": self.why,
        }


def resection_of(
    samples: CaseSamples,
    tumor: SurfaceMesh,
    tool: SurfaceMesh | None,
    *,
    stale_after_ns: int,
    cutting_mm: float = CUTTING_MM,
    ras_from_tumor: FloatArray | None = None,
) -> Resection:
    """The swept volume and the specimen of a case.

    ``tool`` is in the tip's frame; a tool that is its tip alone (None) has no volume.
    ``stale_after_ns``: a longer gap between poses is not swept. A surface that is not closed is the
    reason for no volume. Raises `InputError` for a length that is not positive.
    """
    if tool is None:
        return Resection(cutting_mm, None, 0.0, None, "the tool is its tip alone: no volume")
    try:
        points, body = cutting_points(tool, cutting_mm), solid_of(tumor).simplify(TUMOR_MM)
    except MeshError as error:
        return Resection(cutting_mm, None, 0.0, None, str(error))
    pieces = _pieces(samples, stale_after_ns)
    swept = swept_volume(points, pieces)
    if swept is None:
        why = f"the tool was never within {NEAR_MM:g} mm of the tumour"
        return Resection(cutting_mm, None, 0.0, None, why)
    cut_mm3 = float((body ^ swept.solid).volume())
    specimen = specimen_of(swept.solid, body, tumor, ras_from_tumor)
    why = "" if specimen else "the swept volume does not enclose the tumour"
    return Resection(cutting_mm, swept, cut_mm3, specimen, why)


def specimen_of(
    swept: Any, body: Any, tumor: SurfaceMesh, ras_from_tumor: FloatArray | None = None
) -> Specimen | None:
    """The smallest part of space with half of ``body``, the tumour, that ``swept`` closes off.

    None without one. A part is closed off if it does not reach the outside of the swept volume.
    """
    import manifold3d  # slow to load

    low, high = np.array(swept.bounding_box()).reshape(2, 3)
    tumor_low, tumor_high = tumor.bounds_mm
    low, high = np.minimum(low, tumor_low) - 5.0, np.maximum(high, tumor_high) + 5.0
    box = manifold3d.Manifold.cube(high - low).translate(low)
    whole_mm3 = float(body.volume())
    best: tuple[float, float, Any] | None = None
    for part in (box - swept).decompose():
        # Each part is one closed surface: the outside, a cavity of a part, or the outer surface of
        # a part that is closed off.
        if (
            part.volume() < 0.5 * whole_mm3
            or (np.array(part.bounding_box())[:3] <= low + 1e-9).any()
        ):
            continue
        solid = part - swept
        volume_mm3, shared_mm3 = float(solid.volume()), float((solid ^ body).volume())
        if shared_mm3 >= 0.5 * whole_mm3 and (best is None or volume_mm3 < best[0]):
            best = volume_mm3, shared_mm3, solid
    if best is None:
        return None
    volume_mm3, shared_mm3, solid = best
    surface = surface_of(solid, tumor.frame)
    return Specimen(
        solid,
        surface,
        volume_mm3,
        max(whole_mm3 - shared_mm3, 0.0),
        _margins(surface, tumor, ras_from_tumor),
    )


def _margins(
    specimen: SurfaceMesh, tumor: SurfaceMesh, ras_from_tumor: FloatArray | None
) -> dict[str, float]:
    """Least signed distance of places on the tumour to the specimen's surface, by side."""
    import trimesh  # slow to load

    mesh = trimesh.Trimesh(specimen.vertices_mm, specimen.faces, process=False)
    faces, points, _ = surface_places(tumor, MAX_POINTS)
    sides = sides_of_surface(tumor, ras_from_tumor)[faces]
    nearest: Any = trimesh.proximity.closest_point
    _, distances, _ = nearest(mesh, points)
    bvh = indexed_bvh(specimen.vertices_mm, specimen.faces)
    inside = winding_numbers(dipoles_of(bvh), points) > 0
    signed = np.where(inside, distances, -distances)
    return {side: float(signed[sides == side].min()) for side in SIDES if (sides == side).any()}


def _pieces(samples: CaseSamples, stale_after_ns: int) -> list[tuple[FloatArray, FloatArray]]:
    """Smoothed poses near the tumour, in pieces without a gap in time."""
    rows = near_frames(samples, NEAR_MM)
    if len(rows) == 0:
        return []
    steps = np.diff(samples.stamps_ns[rows])
    ends = np.flatnonzero((steps <= 0) | (steps > stale_after_ns)) + 1
    times = samples.times_s
    return [
        _smoothed(times[piece], samples.tips_mm[piece], samples.rotations[piece])
        for piece in np.split(rows, ends)
    ]


def _smoothed(
    times_s: FloatArray, tips_mm: FloatArray, rotations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Poses without jitter, which would widen the sweep: the filter of `smooth_pieces`."""
    from scipy.spatial.transform import Rotation  # slow to load

    if len(times_s) < 3:
        return tips_mm, rotations
    quaternions = Rotation.from_matrix(rotations).as_quat()
    same = (quaternions[1:] * quaternions[:-1]).sum(axis=1) >= 0.0
    turned = np.cumprod(np.append(1.0, np.where(same, 1.0, -1.0)))  # q and -q are one rotation
    path = np.column_stack([tips_mm, quaternions * turned[:, None]])
    found = smoothed_path(times_s, path)
    return found[:, :3], Rotation.from_quat(found[:, 3:]).as_matrix()
