"""A surface that replaces another one: prepared, and compared in size, position and overlap."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.fixture.meshes.face_measures import solid_of
from app.fixture.meshes.mesh_checks import checked_mesh
from app.fixture.proximity.distance_field import MIN_NODES, build_field
from app.fixture.proximity.engine import PreparedTumor, checked_tumor, prepared_checked
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import FloatArray, FrameError, SurfaceMesh, Transform, weld_vertices

TUMOR = "tumour"

MAX_VOLUME_FACTOR = 2.0
"""A volume that differs by more than this factor is named. Repeated segmentations of one lesion
differ by tens of percent; another lesion or another unit differs by more."""

_POINTS = 2000
"""Points in the bounding box of the smaller tumour at which the overlap is measured."""


@dataclass(frozen=True, slots=True, eq=False)
class TumorChange:
    """A tumour ``before`` and ``after`` its replacement, in the frame that it moves with.

    Volumes in mm3; ``sizes_mm`` (3,) of the bounding box, before and after; ``shift_mm`` of the
    centroid. ``overlap`` is the part of the smaller tumour that lies in the other one, from 0 to 1,
    measured at `_POINTS` points: 0 may be an overlap of less than about 0.2 %. ``what`` names it:
    the tumour or another structure.
    """

    volumes_mm3: tuple[float, float]
    sizes_mm: tuple[FloatArray, FloatArray]
    shift_mm: float
    overlap: float
    what: str = TUMOR

    @property
    def volume_factor(self) -> float:
        """Larger volume over smaller one, at least 1."""
        return max(self.volumes_mm3) / min(self.volumes_mm3)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Properties that are unusual for a new segmentation of the same tumour, in capitals."""
        found = []
        if self.volume_factor > MAX_VOLUME_FACTOR:
            found.append(f"THE VOLUME DIFFERS BY MORE THAN A FACTOR OF {MAX_VOLUME_FACTOR:g}")
        if self.overlap == 0.0:
            found.append(f"IT DOES NOT OVERLAP THE FORMER {self.what.split()[0].upper()}")
        return tuple(found)

    @property
    def text(self) -> str:
        """One line; unusual properties in capitals, first."""
        before, after = self.volumes_mm3
        numbers = (
            f"volume from {before:.4g} to {after:.4g} mm3, "
            f"bounding box from {_size(self.sizes_mm[0])} to {_size(self.sizes_mm[1])} mm, "
            f"centroid moved by {self.shift_mm:.1f} mm, "
            f"{100.0 * self.overlap:.0f} % of the smaller one in the other"
        )
        return f"{self.what} replaced: {'; '.join((*self.warnings, numbers))}"


InsideTest = Callable[[FloatArray], NDArray[np.bool_]]
"""Whether each of some points (n, 3) in mm is inside a surface, (n,)."""


def tumor_change(
    before: SurfaceMesh,
    after: SurfaceMesh,
    inside_after: InsideTest | None = None,
    what: str = TUMOR,
) -> TumorChange:
    """Compare two closed surfaces in one frame. Takes 0.1 s, or seconds for large surfaces.

    ``inside_after`` is a test for ``after``, if one is known already. Raises `FrameError` for
    surfaces in different frames.
    """
    if before.frame != after.frame:
        raise FrameError(
            f"tumours to compare: in {before.frame!r} and {after.frame!r}; expected one frame"
        )
    solids = [
        solid_of(each.vertices_mm, each.faces, each.vertices_mm.mean(axis=0))
        for each in (before, after)
    ]
    volumes = (solids[0][0], solids[1][0])
    sizes = tuple(high - low for low, high in (before.bounds_mm, after.bounds_mm))
    shift = np.subtract(solids[1][1], solids[0][1])
    tests = ((before, None), (after, inside_after))
    smaller, larger = tests if volumes[0] < volumes[1] else tests[::-1]
    return TumorChange(
        volumes_mm3=volumes,
        sizes_mm=(sizes[0], sizes[1]),
        shift_mm=float(np.linalg.norm(shift)),
        overlap=_overlap(*smaller, *larger),
        what=what,
    )


def _overlap(
    smaller: SurfaceMesh,
    inside_smaller: InsideTest | None,
    larger: SurfaceMesh,
    inside_larger: InsideTest | None,
) -> float:
    low, high = smaller.bounds_mm
    other_low, other_high = larger.bounds_mm
    if (np.minimum(high, other_high) < np.maximum(low, other_low)).any():
        return 0.0
    points = low + (high - low) * _spread_points(_POINTS)
    inside = points[(inside_smaller or _inside_test(smaller))(points)]
    if len(inside) == 0:
        return 0.0
    return float((inside_larger or _inside_test(larger))(inside).mean())


def _inside_test(mesh: SurfaceMesh) -> InsideTest:
    vertices, faces, _ = weld_vertices(mesh.vertices_mm, mesh.faces)
    dipoles = dipoles_of(indexed_bvh(vertices, faces))
    return lambda points_mm: np.asarray(winding_numbers(dipoles, points_mm) > 0)


def _spread_points(count: int) -> FloatArray:
    """Points (count, 3) in the unit cube: a sequence of low discrepancy (Roberts 2018)."""
    root = 1.2207440846057596  # of x^4 = x + 1
    steps = np.array([root**-1, root**-2, root**-3])
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)


def _size(size_mm: FloatArray) -> str:
    return " x ".join(f"{side:.1f}" for side in size_mm)


_RING_SIDE = 102
_FEW_NODES = 1000


class TumorReplacement(NamedTuple):
    """A surface prepared for `app.fixture.ProximityEngine`, and its change from another one."""

    prepared: PreparedTumor
    change: TumorChange | None


def prepare_replacement(
    before: SurfaceMesh | None,
    tumor: SurfaceMesh,
    frame_from_tumor: Transform,
    what: str = TUMOR,
) -> TumorReplacement:
    """Check and prepare ``tumor``, and compare it with ``before``, in the frame of that.

    ``what`` names the tumour or another structure, ``before`` is None for a new one. One function
    for both, because the comparison needs the tree that the check has built. Raises `MeshError`
    for a surface that bounds no solid, and `FrameError` if ``frame_from_tumor`` does not lead from
    the frame of ``tumor`` to that of ``before``.
    """
    checked = checked_mesh(tumor, mesh_of(what))
    if before is None:
        return TumorReplacement(prepared_checked(checked), None)
    tumor_from_frame = frame_from_tumor.inverse()

    def inside_tumor(points_mm: FloatArray) -> NDArray[np.bool_]:
        numbers = winding_numbers(checked.dipoles, tumor_from_frame.apply(points_mm))
        return np.asarray(numbers > 0)

    change = tumor_change(before, tumor.transformed(frame_from_tumor), inside_tumor, what)
    return TumorReplacement(prepared_checked(checked), change)


def mesh_of(what: str) -> str:
    """Name of the mesh of ``what``, for messages."""
    return "the tumour's mesh" if what == TUMOR else f"the mesh of {what}"


def load_replacement() -> None:
    """Load the libraries and compiled functions that `prepare_replacement` needs: 0.5 s or more."""
    ring = _ring()
    checked = checked_tumor(ring)
    prepared = prepared_checked(checked, _FEW_NODES)
    # Directly, because the field of a known surface is read from a file.
    build_field(prepared.body.fixed.surface, MIN_NODES + 1)
    tumor_change(ring, ring)


def _ring() -> SurfaceMesh:
    """A torus of so many triangles that functions for large surfaces are used."""
    first, second = (index.ravel() for index in np.indices((_RING_SIDE, _RING_SIDE)))
    along, around = (2.0 * np.pi / _RING_SIDE * index for index in (first, second))
    outward = np.stack([np.cos(along), np.sin(along), np.zeros_like(along)], axis=1)
    height = np.array([0.0, 0.0, 1.0])
    vertices = (10.0 + 4.0 * np.cos(around))[:, None] * outward
    vertices += 4.0 * np.sin(around)[:, None] * height
    here, beyond = (_RING_SIDE * (index % _RING_SIDE) for index in (first, first + 1))
    next_around = (second + 1) % _RING_SIDE
    a, b, c, d = here + second, beyond + second, beyond + next_around, here + next_around
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return SurfaceMesh("tumor", vertices, faces)
