"""A tumour that replaces another one, prepared and compared with it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.fixture.proximity.distance_field import MIN_NODES, build_field
from app.fixture.proximity.engine import PreparedTumor, checked_tumor, prepared_checked
from app.fixture.surfaces.winding_number import winding_numbers
from app.geometry import FloatArray, SurfaceMesh, Transform
from app.session.tumor_change import TumorChange, tumor_change

_RING_SIDE = 102
_FEW_NODES = 1000


class TumorReplacement(NamedTuple):
    """A tumour prepared for `app.fixture.ProximityEngine`, and its change from another one."""

    prepared: PreparedTumor
    change: TumorChange


def prepare_replacement(
    before: SurfaceMesh, tumor: SurfaceMesh, frame_from_tumor: Transform
) -> TumorReplacement:
    """Check and prepare ``tumor``, and compare it with ``before``, in the frame of that.

    One function for both, because the comparison needs the tree that the check has built. Raises
    `MeshError` for a surface that bounds no solid, and `FrameError` if ``frame_from_tumor`` does
    not lead from the frame of ``tumor`` to that of ``before``.
    """
    checked = checked_tumor(tumor)
    tumor_from_frame = frame_from_tumor.inverse()

    def inside_tumor(points_mm: FloatArray) -> NDArray[np.bool_]:
        numbers = winding_numbers(checked.dipoles, tumor_from_frame.apply(points_mm))
        return np.asarray(numbers > 0)

    change = tumor_change(before, tumor.transformed(frame_from_tumor), inside_tumor)
    return TumorReplacement(prepared_checked(checked), change)


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
