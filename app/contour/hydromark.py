"""The surface of a marked hydromark: a clip of known size that ultrasound shows."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from app.geometry import FloatArray, MeshError, SurfaceMesh

MAX_RADIUS_MM = 20.0
MAX_MARKS = 20
"""Points that mark a clip: its ends, and some between them."""

_DIRECTIONS = 800
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def hydromark_surface(
    points_mm: FloatArray, radius_mm: float, dilation_mm: float, frame: str
) -> SurfaceMesh:
    """The closed surface at ``radius_mm`` plus ``dilation_mm`` around ``points_mm`` (n, 3).

    It is around the convex hull of the points: a ball for one point, a capsule for two or for
    points in a line. Its faces are outside of that shape, by 0.5 % of the radius at most. Raises
    `MeshError` for no point or too many, and for a radius out of range.
    """
    if not 0.0 < radius_mm <= MAX_RADIUS_MM:
        raise MeshError(
            f"hydromark: a radius of {radius_mm:.6g} mm; expected above 0 to {MAX_RADIUS_MM:g} mm"
        )
    if not 1 <= len(points_mm) <= MAX_MARKS:
        raise MeshError(f"hydromark: {len(points_mm)} points; expected 1 to {MAX_MARKS}")
    ball = (radius_mm + dilation_mm) * _ball()
    around = (points_mm[:, None, :] + ball[None, :, :]).reshape(-1, 3)
    try:
        hull = ConvexHull(around)
    except QhullError as error:
        raise MeshError("hydromark: the points have no surface; expected other points") from error
    vertices, faces = _used(around, hull.simplices)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return SurfaceMesh(frame, vertices, faces)


def _used(points: FloatArray, faces: NDArray[np.int32]) -> tuple[FloatArray, NDArray[np.int32]]:
    """The points of ``faces``, and the faces with their numbers among these."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return points[used], renumbered.reshape(faces.shape).astype(np.int32)


@lru_cache(maxsize=1)
def _ball() -> FloatArray:
    """Corners (n, 3) of a polyhedron around the unit ball, spread evenly."""
    index = np.arange(_DIRECTIONS)
    z = 1.0 - (2.0 * index + 1.0) / _DIRECTIONS
    across = np.sqrt(1.0 - z**2)
    angle = _GOLDEN_ANGLE * index
    corners = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
    return np.asarray(corners / -ConvexHull(corners).equations[:, 3].max())
