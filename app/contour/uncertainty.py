"""Distance of a contour's surface from the tumour's, as a standard deviation in mm."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from app.geometry import FloatArray, SurfaceMesh


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
