"""Closed, smooth surfaces of a tumour: around points that a surgeon placed, or of marked voxels.

Around points, LumpNav takes the convex hull and rounds it by a subdivision that interpolates them.
Here the surface is a radius for every direction instead. It needs fewer points for the same error
of the volume, and it contains every point, which a subdivision does not guarantee.

The points are first transformed to the axes in which their solid hull has the moments of the unit
ball, so that points of an ellipsoid lie on a sphere. There the radius is interpolated over the unit
sphere by a thin-plate spline with a linear part (Duchon 1977; `scipy.interpolate.RBFInterpolator`)
and limited to between the hull's own radius and the largest radius of a point: the surface does
not cut into the hull, and stays within the ellipsoid with the hull's moments through the outermost
point.

Of marked voxels, the surface is accurate to a fraction of a voxel. Each part (voxels joined by
faces, edges or corners) is built on its own: its marks are blurred by one voxel, and marching cubes
(Lorensen and Cline 1987, from scikit-image) extracts a level set.
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

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
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
from scipy.spatial import ConvexHull, QhullError, cKDTree
from skimage.measure import marching_cubes

from app.geometry import FloatArray, MeshError, SurfaceMesh

MIN_SIZE_MM, MAX_SIZE_MM = 0.5, 1000.0
"""Limits of the longest side of the box around the points: 20 mm given in metres measure 0.02."""

MAX_POINTS = 2000
"""The interpolation solves a dense system with one row per point."""

CLEARANCE_MM = 1e-3
"""Distance of each point from the surface, towards its middle; more than the rounding of a file in
single precision."""

_MIN_THICKNESS = 1 / 50
"""Minimum thickness of the points, as a fraction of their largest extent."""

_MAX_OUTLIER_RATIO = 10.0
"""Maximum distance of a point to the median point, as a multiple of the median distance."""

_SUBDIVISIONS = 4
"""Subdivisions of an icosahedron: 2562 directions at 4.4 degrees, 5120 triangles."""

_EDGE_SAMPLES = 32
_NEAREST_FACES = 8
_SAME_DIRECTION = 1e-3


def surface_around(points_mm: FloatArray, frame: str) -> SurfaceMesh:
    """A closed surface, normals outward, that contains all of ``points_mm`` (n, 3) in ``frame``.

    Needs four points or more that are not in one plane; duplicates count once. Hollows between the
    points are filled, as in LumpNav: the surface is that of their convex hull, rounded outward.
    Raises `MeshError` for too few or too many points, values that are not finite, points in one
    plane, a point far from all others, and an extent that no tumour has.
    """
    points = _checked(points_mm)
    centre, frame_from_ball = _moments(_hull(points))
    ball = _hull(np.linalg.solve(frame_from_ball, (points - centre).T).T)
    sphere = trimesh.creation.icosphere(subdivisions=_SUBDIVISIONS)
    directions, faces = np.asarray(sphere.vertices), np.asarray(sphere.faces)
    radii = np.maximum(_smooth_radii(ball, directions), _hull_radii(ball, directions))
    radii = _raised(radii, _outermost(ball), directions, faces)
    corners_mm = np.linalg.norm((points - centre)[ball.vertices], axis=1)
    radii *= 1.0 + CLEARANCE_MM / corners_mm.min()
    return SurfaceMesh(frame, centre + (directions * radii[:, None]) @ frame_from_ball.T, faces)


def _checked(points_mm: FloatArray) -> FloatArray:
    """The distinct points (n, 3), checked."""
    given = np.array(points_mm, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != 3:
        raise MeshError(f"contoured points have shape {given.shape}; expected (n, 3)")
    finite = np.isfinite(given).all(axis=1)
    if not finite.all():
        first = int(np.argmin(finite))
        raise MeshError(
            f"contoured point {first + 1} is {given[first].tolist()}; expected 3 finite numbers"
        )
    points = np.unique(given + 0.0, axis=0)
    if not 4 <= len(points) <= MAX_POINTS:
        raise MeshError(
            f"{len(given)} contoured points, {len(points)} of them distinct; "
            f"expected 4 to {MAX_POINTS} distinct points"
        )
    size = float(np.ptp(points, axis=0).max())
    if not MIN_SIZE_MM <= size <= MAX_SIZE_MM:
        raise MeshError(
            f"the contoured points span {size:.6g} mm; "
            f"expected {MIN_SIZE_MM:g} to {MAX_SIZE_MM:g} mm "
            "(check the unit, and for a stray point)"
        )
    from_middle = np.linalg.norm(given - np.median(points, axis=0), axis=1)
    typical = float(np.median(from_middle))
    farthest = int(np.argmax(from_middle))
    if from_middle[farthest] > _MAX_OUTLIER_RATIO * typical:
        raise MeshError(
            f"contoured point {farthest + 1} at {np.round(given[farthest], 3).tolist()} mm is "
            f"{from_middle[farthest]:.6g} mm from the median point, and half of them within "
            f"{typical:.6g} mm; expected {_MAX_OUTLIER_RATIO:g} times that or less"
        )
    centred = points - points.mean(axis=0)
    extents = np.ptp(centred @ np.linalg.svd(centred, full_matrices=False)[2].T, axis=0)
    if extents.min() < _MIN_THICKNESS * extents.max():
        raise MeshError(
            f"the contoured points are {extents.max():.6g} mm long and {extents.min():.6g} mm "
            f"thick, nearly in one plane; expected {_MIN_THICKNESS * extents.max():.6g} mm or more"
        )
    return points


def _hull(points: NDArray[np.floating[Any]]) -> ConvexHull:
    try:
        return ConvexHull(points)
    except QhullError as error:
        reason = str(error).splitlines()[0]
        raise MeshError(f"the contoured points do not span a solid: {reason}") from error


def _moments(hull: ConvexHull) -> tuple[FloatArray, FloatArray]:
    """The centroid (3,) of the solid hull, and the axes (3, 3) in which it has a ball's moments.

    The hull is split into tetrahedra with a common corner. The integral of x x^T over a tetrahedron
    with corners 0, a, b, c and volume V is V / 20 (a a^T + b b^T + c c^T + s s^T), s = a + b + c;
    over the unit ball it is its volume / 5 times the identity.
    """
    inside = hull.points[hull.vertices].mean(axis=0)
    corners = hull.points[hull.simplices] - inside
    volumes = np.abs(np.linalg.det(corners))
    centroid = np.average(corners.sum(axis=1) / 4.0, axis=0, weights=volumes)
    # Moving the origin to the centroid keeps the volumes of the tetrahedra.
    corners = np.concatenate([corners, np.zeros_like(corners[:, :1])], axis=1) - centroid
    sums = corners.sum(axis=1)
    weights = volumes / volumes.sum() / 20.0
    moments = np.einsum("n,nki,nkj->ij", weights, corners, corners)
    moments += np.einsum("n,ni,nj->ij", weights, sums, sums)
    return inside + centroid, np.asarray(np.linalg.cholesky(5.0 * moments))


def _smooth_radii(hull: ConvexHull, directions: FloatArray) -> FloatArray:
    """The interpolated radius (m,) along ``directions`` (m, 3), at most the largest of a corner."""
    corners = hull.points[hull.vertices]
    radii = np.linalg.norm(corners, axis=1)
    towards = corners / radii[:, None]
    # Two corners in nearly the same direction would make the system singular.
    _, distinct = np.unique(np.round(towards / _SAME_DIRECTION), axis=0, return_index=True)
    smooth = RBFInterpolator(
        towards[distinct], radii[distinct], kernel="thin_plate_spline", degree=1
    )
    return np.asarray(np.minimum(smooth(directions), radii.max()))


def _hull_radii(hull: ConvexHull, directions: FloatArray) -> FloatArray:
    """Distance (m,) from the origin, which is inside, to the hull along ``directions`` (m, 3)."""
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    return np.asarray(1.0 / (directions @ (normals / -offsets[:, None]).T).max(axis=1))


def _outermost(hull: ConvexHull) -> FloatArray:
    """Points (n, 3) of the hull farthest out: its corners and samples along its edges."""
    sides = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]],
                            hull.simplices[:, [2, 0]]])  # fmt: skip
    start, end = hull.points[np.unique(np.sort(sides, axis=1), axis=0)].swapaxes(0, 1)
    along = np.linspace(0.0, 1.0, _EDGE_SAMPLES + 1)[:, None, None]
    return np.asarray((start + along * (end - start)).reshape(-1, 3))


def _raised(
    radii: FloatArray, inside: FloatArray, directions: FloatArray, faces: NDArray[np.int64]
) -> FloatArray:
    """Raise ``radii`` (m,) where needed until the surface contains all of ``inside`` (n, 3).

    A point x = w_a u_a + w_b u_b + w_c u_c in the cone of a triangle with corners r u is inside it
    where w_a / r_a + w_b / r_b + w_c / r_c <= 1. That sum decreases with every r, so raising a
    triangle for one point keeps all other points inside.
    """
    corners = directions[faces]
    weights_from_point = np.linalg.inv(corners.swapaxes(1, 2))
    towards = inside / np.linalg.norm(inside, axis=1, keepdims=True)
    near = np.asarray(cKDTree(corners.mean(axis=1)).query(towards, k=_NEAREST_FACES)[1])
    weights = np.einsum("nkij,nj->nki", weights_from_point[near], inside)
    cone = weights.min(axis=2).argmax(axis=1)
    rows = np.arange(len(inside))
    corner_of = faces[near[rows, cone]]
    beyond = (weights[rows, cone] / radii[corner_of]).sum(axis=1)
    factors = np.ones_like(radii)
    np.maximum.at(factors, corner_of, beyond[:, None])
    return radii * factors


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
