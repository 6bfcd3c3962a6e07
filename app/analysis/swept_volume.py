"""Volume that the cutting part of the tool has swept, as a solid of manifold3d.

The cutting part is the convex hull of the part of the tool within a distance of its tip. Between
two poses it sweeps the convex hull of both: exact for a translation, and for a rotation up to the
sagitta of the arcs. Poses are left out where the straight motion between their neighbours passes
every point of the cutting part within a stated tolerance, which bounds the number of hulls.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError, MeshError, SurfaceMesh

CUTTING_MM = 10.0
"""Length of the cutting part from the tip, unless another is given."""
TOLERANCE_MM = 0.05
_FIRST_MM = 0.4
"""Doubled until at most `MAX_STEPS` poses remain. A typical case needs `_FIRST_MM`, tried first."""
MAX_STEPS = 200
MAX_POINTS = 144
"""Points of the cutting part. Where it has more, a body of fewer with the same size and extent in
each direction stands for it."""
_SPHERE_SEGMENTS = 64


@dataclass(frozen=True, slots=True, eq=False)
class SweptVolume:
    """``solid``: the swept volume, a `manifold3d.Manifold` in the tumour's frame.

    ``poses`` and ``hulls``: how many were swept, and of how many hulls the solid is made.
    ``tolerance_mm``: how far a point of the cutting part is from its path at most.
    """

    solid: Any
    poses: int
    hulls: int
    tolerance_mm: float

    @property
    def volume_mm3(self) -> float:
        """The swept volume."""
        return float(self.solid.volume())


def cutting_points(tool: SurfaceMesh, cutting_mm: float = CUTTING_MM) -> FloatArray:
    """Corners (k, 3) of the cutting part, in the tip's frame.

    ``tool`` is in the tip's frame, whose origin is the tip. Raises `InputError` for a length that
    is not positive, `MeshError` for a tool that is not closed or has no part within it.
    """
    import manifold3d  # slow to load

    if not (math.isfinite(cutting_mm) and cutting_mm > 0.0):
        raise InputError(f"cutting part: {cutting_mm:g} mm; expected more than 0")
    ball = manifold3d.Manifold.sphere(cutting_mm, _SPHERE_SEGMENTS)
    near = solid_of(tool) ^ ball
    if near.is_empty():
        raise MeshError(
            f"cutting part: no part of the tool is within {cutting_mm:g} mm of its tip; "
            "expected a tool with its tip at the origin"
        )
    hull = near.hull()
    points = _points_of(hull)
    if len(points) <= MAX_POINTS:
        return points
    return _fewer_points(hull)


def _fewer_points(hull: Any) -> FloatArray:
    """At most `MAX_POINTS` corners (k, 3) of a body like ``hull``.

    They are the farthest corners in directions that are spread evenly over the body stretched to a
    round one, which a Fibonacci lattice does.
    """
    import manifold3d  # slow to load

    points = _points_of(hull)
    _, centre, spread = _moments_of(hull)
    rank = np.arange(MAX_POINTS) + 0.5
    height, turn = 1.0 - 2.0 * rank / MAX_POINTS, math.pi * (1.0 + math.sqrt(5.0)) * rank
    aside = np.sqrt(1.0 - height**2)
    directions = np.stack([aside * np.cos(turn), aside * np.sin(turn), height])
    round_points = (points - centre) @ np.linalg.inv(_root(spread))
    chosen = np.unique((round_points @ directions).argmax(axis=0))
    return _with_moments_of(hull, manifold3d.Manifold.hull_points(points[chosen]))


def _with_moments_of(body: Any, fewer: Any) -> FloatArray:
    """The corners (k, 3) of the solid ``fewer``, stretched to the moments of the solid ``body``.

    Corners on the surface of a round body enclose too little: 144 of a ball 5 % less. Centre and
    second moments become those of ``body``; the size is between that of the same volume, which a
    resting body sweeps, and that of the same surface, whose shadow a moving one sweeps.
    """
    import manifold3d  # slow to load

    volume, centre, spread = _moments_of(body)
    own_volume, own_centre, own_spread = _moments_of(fewer)
    stretch = _root(spread) @ np.linalg.inv(_root(own_spread))
    stretch *= (volume / (own_volume * abs(np.linalg.det(stretch)))) ** (1.0 / 3.0)
    points = (_points_of(fewer) - own_centre) @ stretch.T
    area = float(manifold3d.Manifold.hull_points(points).surface_area())
    return np.asarray(points * (float(body.surface_area()) / area) ** 0.25 + centre)


def _moments_of(solid: Any) -> tuple[float, FloatArray, FloatArray]:
    """Volume, centre (3,) and covariance (3, 3) of a solid, from tetrahedra to the origin."""
    mesh = solid.to_mesh64()
    corners = np.array(mesh.vert_properties[:, :3])[np.asarray(mesh.tri_verts)]
    volumes = np.linalg.det(corners) / 6.0
    volume, sums = float(volumes.sum()), corners.sum(axis=1)
    centre = (volumes @ sums) / (4.0 * volume)
    squares = np.einsum("nki,nkj->nij", corners, corners) + np.einsum("ni,nj->nij", sums, sums)
    second = np.einsum("n,nij->ij", volumes, squares) / (20.0 * volume)
    return volume, centre, second - np.outer(centre, centre)


def _root(matrix: FloatArray) -> FloatArray:
    """The symmetric square root of a positive definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(values)) @ vectors.T)


def swept_volume(
    points_mm: FloatArray,
    pieces: Sequence[tuple[FloatArray, FloatArray]],
    *,
    max_steps: int = MAX_STEPS,
) -> SweptVolume | None:
    """The volume that the convex body with corners ``points_mm`` (k, 3) sweeps.

    ``pieces`` are its poses, tips (n, 3) and rotations (n, 3, 3), between which the motion is
    known; nothing is swept from one piece to the next. None without a pose.
    """
    import manifold3d  # slow to load

    pieces = [piece for piece in pieces if len(piece[0])]
    if not pieces:
        return None
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    boxes = [_moved(box, *piece) for piece in pieces]
    tolerance_mm, kept = _thinned(boxes, max(max_steps, 2 * len(boxes)))
    hulls = [
        manifold3d.Manifold.hull_points(np.ascontiguousarray(corners.reshape(-1, 3)))
        for (tips, rotations), rows in zip(pieces, kept, strict=True)
        for corners in _pairs(_moved(points_mm, tips[rows], rotations[rows]))
    ]
    solid = manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)
    return SweptVolume(solid, sum(map(len, boxes)), len(hulls), tolerance_mm)


def solid_of(surface: SurfaceMesh) -> Any:
    """``surface`` as a solid; raises `MeshError` where it is not closed."""
    import manifold3d  # slow to load

    used, index = np.unique(surface.faces, return_inverse=True)
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(
            np.ascontiguousarray(surface.vertices_mm[used]),
            np.ascontiguousarray(index.reshape(-1, 3), dtype=np.uint64),
        )
    )
    if solid.status() != manifold3d.Error.NoError:
        raise MeshError(
            f"surface in {surface.frame!r}: no solid ({solid.status().name}); "
            "expected a closed surface"
        )
    return solid


def surface_of(solid: Any, frame: str) -> SurfaceMesh:
    """The surface of ``solid``, in ``frame``."""
    mesh = solid.to_mesh64()
    return SurfaceMesh(frame, mesh.vert_properties[:, :3], np.asarray(mesh.tri_verts))


def _points_of(solid: Any) -> FloatArray:
    return np.array(solid.to_mesh64().vert_properties[:, :3], dtype=np.float64)


def _moved(points_mm: FloatArray, tips_mm: FloatArray, rotations: FloatArray) -> FloatArray:
    """The points (k, 3) at each pose, (n, k, 3)."""
    return np.asarray(np.einsum("kj,nij->nki", points_mm, rotations) + tips_mm[:, None])


def _pairs(path: FloatArray) -> list[FloatArray]:
    """The corners of each two successive poses; those of the only one of a path of one pose."""
    if len(path) == 1:
        return [path[0]]
    return [path[index : index + 2] for index in range(len(path) - 1)]


def _thinned(boxes: Sequence[FloatArray], max_steps: int) -> tuple[float, list[NDArray[np.intp]]]:
    """The least tolerance with which at most ``max_steps`` rows of all paths remain, and these."""

    def rows(tolerance: float) -> list[NDArray[np.intp]]:
        return [_kept(path, tolerance) for path in boxes]

    tolerance_mm = _FIRST_MM
    kept = rows(tolerance_mm)
    while sum(map(len, kept)) > max_steps:
        tolerance_mm *= 2.0
        kept = rows(tolerance_mm)
    while tolerance_mm > TOLERANCE_MM and tolerance_mm <= _FIRST_MM:
        finer = rows(0.5 * tolerance_mm)
        if sum(map(len, finer)) > max_steps:
            break
        tolerance_mm, kept = 0.5 * tolerance_mm, finer
    return tolerance_mm, kept


def _kept(path: FloatArray, tolerance_mm: float) -> NDArray[np.intp]:
    """Rows of ``path`` (n, 8, 3), such that the others are within the tolerance of a straight line.

    The end of each straight motion is found by doubling its length, then by bisection.
    """
    kept, start, last = [0], 0, len(path) - 1
    while start < last:
        good, step = start + 1, 2
        while start + step <= last and _deviation(path[start : start + step + 1]) <= tolerance_mm:
            good, step = start + step, 2 * step
        bad = min(start + step, last + 1)
        while bad - good > 1:
            middle = (good + bad) // 2
            if _deviation(path[start : middle + 1]) <= tolerance_mm:
                good = middle
            else:
                bad = middle
        kept.append(good)
        start = good
    return np.array(kept, dtype=np.intp)


def _deviation(path: FloatArray) -> float:
    """Largest distance of the inner poses from the straight motion from the first to the last.

    ``path`` (m, 8, 3) are the corners of a box. At one place of the motion the distance of a point
    is a convex function of the point, so that no point of the box is farther off than its corners.
    """
    along, offset = path[-1] - path[0], path[1:-1] - path[0]
    length2 = max(float((along * along).sum()), 1e-18)
    part = np.clip(offset.reshape(-1, 24) @ along.ravel() / length2, 0.0, 1.0)
    off = offset - part[:, None, None] * along
    return math.sqrt(float(np.einsum("nki,nki->nk", off, off).max(initial=0.0)))
