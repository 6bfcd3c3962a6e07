"""The surface of the voxels that were marked, smooth to a part of a voxel.

Each part (voxels joined by faces, edges or corners) is shaped on its own: its marks are blurred by
one voxel, and marching cubes (Lorensen and Cline 1987, of scikit-image) finds the level between in
and out. Blurring alone would shrink what is round and lose what is thin, so

- the surface crosses the line from a marked voxel's centre to a neighbour's that is not marked at
  `_LEAST_REACH` voxels or more, and that neighbour's centre is outside;
- a marked voxel that no cross of seven marked ones contains is thin: there the surface contains the
  centres of the voxel's open faces, and more where it is thin along two axes or all three;
- the level is chosen such that the part encloses the volume of its voxels, or the least above that
  which the first two rules allow.

So every place of the surface lies among eight neighbouring voxel centres of which some are marked
and some are not: it is off by less than the diagonal of a voxel, and by far less where it is round.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_opening,
    find_objects,
    gaussian_filter,
    generate_binary_structure,
    label,
    minimum_filter,
)
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

_LEAST_REACH = 0.2
_THIN_REACH = (0.5, 0.5, 0.5**0.5, 6.0 ** (1.0 / 3.0) / 2.0)
"""Voxels from a thin voxel's centre to the surface, by the number of axes along which it is one
voxel thick: the cross-polytope of n axes with these half-diagonals has the volume of the voxel."""

_LEAST_SHIFT, _MOST_SHIFT = -0.3, 1.0
"""Of the level. At the most any voxel reaches so far out that no volume is missing."""

_SHIFT_STEP = 0.003
_CROSS = generate_binary_structure(3, 1)
_CUBE = generate_binary_structure(3, 3)


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
    if np.prod(np.add(marked.shape, 2 * _BORDER)) > MAX_VOXELS:
        raise MeshError(
            f"the marked voxels span {' x '.join(map(str, marked.shape))}: "
            f"{MAX_VOXELS} with their border allowed"
        )
    parts, _ = label(marked, _CUBE)
    vertices, faces, count = [], [], 0
    for number, box in enumerate(find_objects(parts), start=1):
        part_vertices, part_faces = _surface_of_part(np.pad(parts[box] == number, _BORDER))
        vertices.append(part_vertices - _BORDER + [side.start for side in box])
        faces.append(part_faces + count)
        count += len(part_vertices)
    linear, origin = frame_from_index[:, :3], frame_from_index[:, 3]
    turn = -1 if np.linalg.det(linear) < 0.0 else 1
    return SurfaceMesh(
        frame, np.concatenate(vertices) @ linear.T + origin, np.concatenate(faces)[:, ::turn]
    )


def _surface_of_part(inside: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.int32]]:
    """The surface in voxels that encloses as many of them as are ``inside``, or a little more."""
    blurred = gaussian_filter(inside.astype(np.float32), _BLUR_VOXELS) - np.float32(0.5)
    lowest_beside = minimum_filter(np.where(inside, np.inf, blurred), footprint=_CROSS)
    reach = _reach(inside)
    steeper = (reach / (1.0 - reach)).astype(np.float32)
    wanted = float(inside.sum())

    def surface(shift: float) -> tuple[FloatArray, NDArray[np.int32]]:
        field = blurred + np.float32(shift)
        # Between +a and -b the level is crossed at a / (a + b) of the way.
        least = steeper * np.maximum(-(lowest_beside + np.float32(shift)), _APART)
        field = np.where(
            inside, np.maximum(field, np.maximum(least, _APART)), np.minimum(field, -_APART)
        )
        # What the corners' sides leave open, Lorensen's tables decide alike in neighbouring cubes.
        # Lewiner's, the default, look at the values and now and then give an edge four faces.
        vertices, faces, *_ = marching_cubes(
            field.astype(np.float32), 0.0, gradient_direction="ascent", method="lorensen"
        )
        return vertices.astype(np.float64), faces

    def excess(shift: float) -> float:
        vertices, faces = surface(shift)
        return SurfaceMesh("voxels", vertices, faces).signed_volume_mm3 - wanted

    if excess(_LEAST_SHIFT) >= 0.0:
        return surface(_LEAST_SHIFT)
    # A step above the root that was found: rather too large than too small.
    return surface(brentq(excess, _LEAST_SHIFT, _MOST_SHIFT, xtol=_SHIFT_STEP) + _SHIFT_STEP)


def _reach(inside: NDArray[np.bool_]) -> FloatArray:
    """How far from each centre, in voxels, the surface crosses the way to a neighbour at least."""
    thin = inside & ~binary_opening(inside, _CROSS)
    open_axes = np.zeros(inside.shape, dtype=np.int64)
    for axis in range(3):
        open_axes += ~(np.roll(inside, 1, axis) | np.roll(inside, -1, axis))
    return np.where(thin, np.take(_THIN_REACH, open_axes), _LEAST_REACH)
