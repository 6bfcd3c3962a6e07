"""The surface of the voxels that were marked, smooth to a part of a voxel.

The marks are blurred by one voxel and marching cubes (Lorensen and Cline 1987, of scikit-image)
finds the level between in and out. Blurring alone would shrink what is round and lose what is
thin, so

- the blurred value stays on its own side of the level at every voxel's centre: the centre of each
  marked voxel is inside the surface, that of every other one outside, and thin parts stay;
- the level is chosen such that the surface encloses the volume of the marked voxels, as far as
  the first rule leaves room.

So every place of the surface lies among eight neighbouring voxel centres of which some are marked
and some are not: it is off by less than the diagonal of a voxel, and by far less where it is round.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import brentq
from skimage.measure import marching_cubes

from app.geometry import FloatArray, MeshError, SurfaceMesh

MAX_VOXELS = 1 << 25
"""Of the box around the marked voxels: some 20 bytes each are needed."""

_BLUR_VOXELS = 1.0
_BORDER = 4
"""Voxels of outside around the marks: the blur is cut off there."""

_APART = np.float32(0.05)
"""How far from the level a voxel's own centre stays, so that no triangle loses its area."""

_LEVEL_RANGE, _LEVEL_STEP = 0.3, 0.003


def surface_of_labels(
    marked: NDArray[np.bool_], frame_from_index: FloatArray, frame: str
) -> SurfaceMesh:
    """The closed surface, normals outward, of the true voxels of ``marked`` (i, j, k).

    ``frame_from_index`` (3, 4) maps the index of a voxel to its centre in mm in ``frame``; it may
    be oblique and left-handed. At the border of the array the surface runs along the voxels'
    faces, to a tenth of a voxel. Raises `MeshError` when nothing is marked, and above `MAX_VOXELS`.
    """
    if not marked.any():
        raise MeshError("no voxel is marked: one at least wanted")
    inside = np.pad(marked, _BORDER)
    if inside.size > MAX_VOXELS:
        raise MeshError(
            f"the marked voxels span {' x '.join(map(str, marked.shape))}: "
            f"{MAX_VOXELS} with their border allowed"
        )
    vertices, faces = _surface_of_volume(inside)
    linear, origin = frame_from_index[:, :3], frame_from_index[:, 3]
    if np.linalg.det(linear) < 0.0:
        faces = faces[:, ::-1]
    return SurfaceMesh(frame, (vertices - _BORDER) @ linear.T + origin, faces)


def _surface_of_volume(inside: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.int32]]:
    """The surface in voxels that encloses as many of them as are ``inside``."""
    blurred = gaussian_filter(inside.astype(np.float32), _BLUR_VOXELS) - np.float32(0.5)
    wanted = float(inside.sum())

    def surface(shift: float) -> tuple[FloatArray, NDArray[np.int32]]:
        field = blurred + np.float32(shift)
        field = np.where(inside, np.maximum(field, _APART), np.minimum(field, -_APART))
        # What the corners' sides leave open, Lorensen's tables decide alike in neighbouring cubes.
        # Lewiner's, the default, look at the values and now and then give an edge four faces.
        vertices, faces, *_ = marching_cubes(
            field, 0.0, gradient_direction="ascent", method="lorensen"
        )
        return vertices.astype(np.float64), faces

    def excess(shift: float) -> float:
        vertices, faces = surface(shift)
        return SurfaceMesh("voxels", vertices, faces).signed_volume_mm3 - wanted

    if excess(_LEVEL_RANGE) <= 0.0:
        return surface(_LEVEL_RANGE)
    if excess(-_LEVEL_RANGE) >= 0.0:
        return surface(-_LEVEL_RANGE)
    return surface(brentq(excess, -_LEVEL_RANGE, _LEVEL_RANGE, xtol=_LEVEL_STEP))
