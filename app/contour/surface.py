"""From a contour to a tumour: the closed surface of its points, with its uncertainty, in words."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from app.case.tumor import surface_around
from app.contour.editor import Contour, ContourPoint
from app.fixture import margin_surface
from app.geometry import FloatArray, MeshError, SurfaceMesh

MAX_RADIUS_MM = 20.0
MAX_MARKS = 20
"""Points that mark a clip: its ends, and some between them."""

_DIRECTIONS = 800
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
MAX_DILATION_MM = 20.0
_SPACING_MM = 0.5


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


def require_simple_outlines(contour: Contour) -> None:
    """Raise `MeshError` if the outline of an image crosses itself, with the points' numbers."""
    for image in contour.images:
        outline = contour.outline(image)
        crossing = _crossing(outline)
        if crossing is not None:
            (a, b), (c, d) = crossing
            raise MeshError(
                f"contour in image {image}: crosses itself between points {a} and {b} and points "
                f"{c} and {d}; expected a simple outline (drag or erase one of these points)"
            )


def _crossing(outline: tuple[ContourPoint, ...]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The numbers of the ends of two edges that cross; None for a simple outline."""
    count = len(outline)
    if count < 4:
        return None
    corners = np.array([point.pixel for point in outline])
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    first, second = shapely.STRtree(edges).query(edges, predicate="intersects")
    apart = (second - first) % count
    # Neighbours share a point.
    for k in np.flatnonzero((first < second) & (apart > 1) & (apart < count - 1)):
        ends = [
            (outline[n].number, outline[(n + 1) % count].number)
            for n in (int(first[k]), int(second[k]))
        ]
        return ends[0], ends[1]
    return None


@dataclass(frozen=True, slots=True)
class ContourUncertainty:
    """Standard deviations in mm of independent errors.

    ``calibration_mm``: of a point's place, by the calibration of probe or tip. ``pixel_mm``: of a
    click, by the size of a pixel. ``spacing_mm``: of the surface between the points.
    """

    calibration_mm: float
    pixel_mm: float
    spacing_mm: float

    @property
    def sigma_mm(self) -> float:
        """All of them together."""
        return math.hypot(self.calibration_mm, self.pixel_mm, self.spacing_mm)


def pixel_sigma(pixel_mm: tuple[float, float]) -> float:
    """Standard deviation in mm of a click whose true place is anywhere in a pixel of this size."""
    return math.sqrt((pixel_mm[0] ** 2 + pixel_mm[1] ** 2) / 2.0 / 12.0)


def spacing_sigma(surface: SurfaceMesh, points_mm: FloatArray) -> float:
    """Root mean square over the surface of how far a tumour may bulge between ``points_mm`` (n, 3).

    At the distance h from the nearest point a surface whose radius of curvature is r may be
    h^2 / (2 r) from a plane through its points; r is the radius of the ball of the same volume.
    The surface follows that bulge where the points let it, so this is an upper estimate for a
    round tumour; it is none for a branch that no point is on.
    """
    h_mm, _ = cKDTree(points_mm).query(surface.triangles_mm.mean(axis=1))
    first, second, third = np.moveaxis(surface.triangles_mm, 1, 0)
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    radius_mm = (3.0 * surface.signed_volume_mm3 / (4.0 * math.pi)) ** (1.0 / 3.0)
    return float(np.sqrt(np.average((h_mm**2 / (2.0 * radius_mm)) ** 2, weights=areas)))


@dataclass(frozen=True, slots=True, eq=False)
class ContourSurface:
    """``mesh``: closed, in the contour's frame. ``uncertainty``: None without a calibration's."""

    mesh: SurfaceMesh
    uncertainty: ContourUncertainty | None


def contour_surface(contour: Contour, pixel_sigma_mm: float) -> ContourSurface:
    """The convex hull of the points, rounded outward, all points inside; then dilated.

    Points of a hydromark are inside of it: its surface is around them at its radius, dilated.

    The hull is that of `app.case.tumor.surface_around`, as for a contour in a file, so that
    hollows are filled as in LumpNav. ``pixel_sigma_mm``: standard deviation of a click. Raises
    `MeshError` in one line for fewer than four points, points that are nearly in one plane, an
    outline that crosses itself, and a dilation out of range.
    """
    dilation_mm = contour.dilation_mm
    if not 0.0 <= dilation_mm <= MAX_DILATION_MM:
        raise MeshError(
            f"dilation of the contour: is {dilation_mm:.6g} mm; "
            f"expected 0 to {MAX_DILATION_MM:g} mm"
        )
    if contour.hydromark_mm:
        return _hydromark(contour, pixel_sigma_mm)
    require_simple_outlines(contour)
    points = contour.positions_mm
    if len(points) < 4:
        raise MeshError(
            f"contour: {len(points)} points; expected 4 or more that are not in one plane"
        )
    mesh = surface_around(points, contour.frame)
    uncertainty = None
    if contour.calibration_mm is not None:
        uncertainty = ContourUncertainty(
            contour.calibration_mm, pixel_sigma_mm, spacing_sigma(mesh, points)
        )
    if dilation_mm > 0.0:
        mesh = margin_surface(mesh, dilation_mm, spacing_mm=_SPACING_MM)
    return ContourSurface(mesh, uncertainty)


def _hydromark(contour: Contour, pixel_sigma_mm: float) -> ContourSurface:
    mesh = hydromark_surface(
        contour.positions_mm, contour.hydromark_mm, contour.dilation_mm, contour.frame
    )
    if contour.calibration_mm is None:
        return ContourSurface(mesh, None)
    # The shape is given: nothing is guessed between the points.
    uncertainty = ContourUncertainty(contour.calibration_mm, pixel_sigma_mm, spacing_mm=0.0)
    return ContourSurface(mesh, uncertainty)


def contour_count(contour: Contour) -> str:
    """The number of points, and the places where they were set."""
    if not contour.points:
        return "no points"
    at_tip = sum(each.image is None for each in contour.points)
    images = len(contour.images)
    places = [f"{images} image{'s' * (images != 1)}"] if images else []
    places += [f"{at_tip} at the tip"] if at_tip else []
    count = len(contour.points)
    return f"{count} point{'s' * (count != 1)}, {', '.join(places)}"


def contour_size(surface: ContourSurface) -> str:
    """Volume and sides of the surface."""
    low, high = surface.mesh.bounds_mm
    sides = " x ".join(f"{side:.1f}" for side in np.subtract(high, low))
    return f"{surface.mesh.signed_volume_mm3 / 1000.0:.2f} cm\N{SUPERSCRIPT THREE}, {sides} mm"


def contour_sigma(uncertainty: ContourUncertainty) -> str:
    """Standard deviation of the surface and its parts."""
    return (
        f"{uncertainty.sigma_mm:.2f} mm: calibration {uncertainty.calibration_mm:.2f}, "
        f"pixel {uncertainty.pixel_mm:.2f}, spacing of the points {uncertainty.spacing_mm:.2f}"
    )
