"""The smooth surface of marked voxels, accurate to a fraction of a voxel.

Each part (voxels joined by faces, edges or corners) is built on its own: its marks are blurred by
one voxel, and marching cubes (Lorensen and Cline 1987, from scikit-image) extracts a level set.
Blurring alone would shrink round parts and lose thin ones. Therefore

- the surface crosses the line from a marked voxel's centre to an unmarked neighbour's centre at
  `_MIN_REACH` voxels or more, and that neighbour's centre is outside;
- a marked voxel that no cross of seven marked voxels contains is thin: there the surface contains
  the centres of the voxel's open faces, and more where it is thin along two or three axes;
- the level is chosen such that the part encloses the volume of its voxels, or the smallest volume
  above that which the first two rules allow.

Every point of the surface thus lies among eight neighbouring voxel centres of which some are marked
and some are not: its error is less than the diagonal of a voxel, and far less where it is round.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_erosion,
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

MAX_VOXELS = 14_000_000
"""Limit on the box around the marked voxels; each takes about 60 bytes of memory and 0.6 us."""

MAX_EDGE_VOXELS = 400_000
"""Marked voxels with an unmarked neighbour; a ball with a diameter of 20 cm has 104 thousand at
1 mm. Noise has more."""

MAX_PARTS = 64
"""Parts that do not touch."""

_BLUR_VOXELS = 1.0
_BORDER = 4
"""Unmarked voxels around the marks; the blur is cut off there."""

_APART = np.float32(0.05)
"""Minimum distance of a voxel's value from the level, so that no triangle degenerates."""

_MIN_REACH = 0.2
_THIN_REACH = (0.5, 0.5, 0.5**0.5, 6.0 ** (1.0 / 3.0) / 2.0)
"""Distance in voxels from a thin voxel's centre to the surface, by the number n of axes along which
it is one voxel thick: the n-dimensional cross-polytope with that half-diagonal has volume 1."""

_MIN_SHIFT, _MAX_SHIFT = -0.3, 1.0
"""Limits of the level. At the upper one every voxel reaches so far that no volume is missing."""

_SHIFT_STEP = 0.003
_CROSS = generate_binary_structure(3, 1)
_CUBE = generate_binary_structure(3, 3)


def surface_of_labels(
    marked: NDArray[np.bool_], frame_from_index: FloatArray, frame: str
) -> SurfaceMesh:
    """Build the closed surface, normals outward, of the true voxels of ``marked`` (i, j, k).

    ``frame_from_index`` (3, 4) maps the index of a voxel to its centre in mm in ``frame``; it may
    be oblique and left-handed. At the border of the array the surface follows the voxels' faces to
    a tenth of a voxel. Raises `MeshError` when no voxel is marked, and above `MAX_VOXELS`,
    `MAX_EDGE_VOXELS` and `MAX_PARTS`.
    """
    if not marked.any():
        raise MeshError("no voxel is marked; expected one or more")
    if np.prod(np.add(marked.shape, 2 * _BORDER)) > MAX_VOXELS:
        raise MeshError(
            f"the marked voxels span {' x '.join(map(str, marked.shape))}; "
            f"expected {MAX_VOXELS} with their border or less"
        )
    edge = int(np.count_nonzero(marked & ~binary_erosion(marked, _CROSS)))
    parts, count_parts = label(marked, _CUBE)
    if edge > MAX_EDGE_VOXELS or count_parts > MAX_PARTS:
        raise MeshError(
            f"the marked voxels have {count_parts} parts that do not touch and {edge} voxels at "
            f"their edge; expected up to {MAX_PARTS} and {MAX_EDGE_VOXELS}: remove small islands "
            "and smooth the segment"
        )
    vertices, faces, count = [], [], 0
    for number, box in enumerate(find_objects(parts), start=1):
        part_vertices, part_faces = _surface_of_part(np.pad(parts[box] == number, _BORDER))
        vertices.append(part_vertices - _BORDER + [side.start for side in box])
        faces.append(part_faces + count)
        count += len(part_vertices)
    linear, origin = frame_from_index[:, :3], frame_from_index[:, 3]
    order = -1 if np.linalg.det(linear) < 0.0 else 1
    return SurfaceMesh(
        frame, np.concatenate(vertices) @ linear.T + origin, np.concatenate(faces)[:, ::order]
    )


def _surface_of_part(inside: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.int32]]:
    """The surface, in voxels, that encloses the volume of ``inside`` or slightly more."""
    blurred = gaussian_filter(inside.astype(np.float32), _BLUR_VOXELS) - np.float32(0.5)
    lowest_beside = minimum_filter(np.where(inside, np.inf, blurred), footprint=_CROSS)
    reach = _reach(inside)
    steeper = (reach / (1.0 - reach)).astype(np.float32)
    volume = float(inside.sum())

    def surface(shift: float) -> tuple[FloatArray, NDArray[np.int32]]:
        field = blurred + np.float32(shift)
        # Between +a and -b the level is crossed at the fraction a / (a + b).
        lowest = steeper * np.maximum(-(lowest_beside + np.float32(shift)), _APART)
        field = np.where(
            inside, np.maximum(field, np.maximum(lowest, _APART)), np.minimum(field, -_APART)
        )
        # Ambiguous cubes: Lorensen's tables decide alike in neighbouring cubes. Lewiner's, the
        # default, depend on the values and occasionally produce an edge with four faces.
        vertices, faces, *_ = marching_cubes(
            field.astype(np.float32), 0.0, gradient_direction="ascent", method="lorensen"
        )
        return vertices.astype(np.float64), faces

    def excess(shift: float) -> float:
        vertices, faces = surface(shift)
        return SurfaceMesh("voxels", vertices, faces).signed_volume_mm3 - volume

    if excess(_MIN_SHIFT) >= 0.0:
        return surface(_MIN_SHIFT)
    # One step above the root: a surface too large is safer than one too small.
    return surface(brentq(excess, _MIN_SHIFT, _MAX_SHIFT, xtol=_SHIFT_STEP) + _SHIFT_STEP)


def _reach(inside: NDArray[np.bool_]) -> FloatArray:
    """Minimum distance in voxels from each centre to the surface on the line to a neighbour."""
    thin = inside & ~binary_opening(inside, _CROSS)
    open_axes = np.zeros(inside.shape, dtype=np.int64)
    for axis in range(3):
        open_axes += ~(np.roll(inside, 1, axis) | np.roll(inside, -1, axis))
    return np.where(thin, np.take(_THIN_REACH, open_axes), _MIN_REACH)
