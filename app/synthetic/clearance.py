"""The true signed distance between tool and tumour, independent of the engine under test.

The sign comes from the tumour's radius function and the size from a dense sampling of its analytic
surface: neither from the mesh nor from a collision library.
"""

import numpy as np
from scipy.spatial import cKDTree

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.synthetic.cautery import NEAR_PART_MM
from app.synthetic.tumour import Tumour, icosphere

NEAR_SPACING_MM = 0.4
"""Maximum distance between samples of the blade and the shaft."""

HANDLE_SPACING_MM = 4.0
"""Maximum distance between samples of the handle, which never comes near the tumour."""

SURFACE_SUBDIVISIONS = 6
"""40 962 samples of the tumour's surface, about 0.3 mm apart."""

_SLOPE_SAFETY = 0.95
_MAX_UNSAMPLED_MM = 0.05
"""How far a lobe can rise between samples that are 0.3 mm apart."""
_COARSE = 32
_BATCH = 16


class Clearance:
    """Signed distance between the surfaces of a tool and a tumour, in mm, negative inside.

    ``height``: along the tumour's rays; exact in sign and cheap. ``distance``: to the tangent plane
    at the nearest sample of the tumour's surface. With samples ``h`` apart on a surface with radius
    of curvature ``R`` its error is ``h^2 / 8R``, below 0.005 mm. The same holds for the samples of
    the tool: below 0.02 mm on a 1.4 mm shaft.
    """

    def __init__(self, tumour: Tumour, tool: SurfaceMesh) -> None:
        directions, _ = icosphere(SURFACE_SUBDIVISIONS)
        self._tumour = tumour
        self._surface_mm = tumour.surface_mm(directions)
        self._normals = tumour.normals(self._surface_mm)
        self._tree = cKDTree(self._surface_mm)
        handle = (tool.triangles_mm[:, :, 2] < -NEAR_PART_MM).all(axis=1)
        self._tool_mm = np.concatenate(
            [
                dense_surface(tool.triangles_mm[~handle], NEAR_SPACING_MM),
                dense_surface(tool.triangles_mm[handle], HANDLE_SPACING_MM),
            ]
        )
        self.tool_length_mm = -float(tool.bounds_mm[0][2])
        radii = np.linalg.norm(self._surface_mm, axis=1)
        self._max_radius_mm = float(radii.max()) + _MAX_UNSAMPLED_MM
        slope = float(np.einsum("ij,ij->i", self._normals, directions).min())
        self.distance_per_height = _SLOPE_SAFETY * slope
        """Lower bound of distance over height: the cosine of the steepest slope."""

    def height_mm(self, tumor_from_tip: Transform) -> float:
        """The minimum height over the tool: negative exactly when the tool is in the tumour."""
        return float(self._tumour.height_mm(self._lowest_points(tumor_from_tip)).min())

    def distance_mm(self, tumor_from_tip: Transform) -> float:
        """The minimum signed distance over the tool."""
        points = self._lowest_points(tumor_from_tip)
        heights = self._tumour.height_mm(points)
        lower_bounds = np.where(heights > 0.0, self.distance_per_height * heights, heights)
        order = np.argsort(lower_bounds)
        best = np.inf
        # In ascending order of the bounds, until no other point can be deeper or nearer.
        for first in range(0, len(order), _BATCH):
            batch = order[first : first + _BATCH]
            if lower_bounds[batch[0]] > best:
                break
            # Outside, the search of a point stops at the distance of the best one.
            bound_mm = best if best > 0.0 else np.inf
            distances = self.point_distances_mm(points[batch], bound_mm)
            best = min(best, float(distances.min()))
        return best

    def point_distances_mm(self, points_mm: FloatArray, bound_mm: float = np.inf) -> FloatArray:
        """The signed distance (n,) of points (n, 3) in the tumour's frame.

        It is infinite for points without a sample of the surface within ``bound_mm``.
        """
        to_sample, samples = self._tree.query(points_mm, distance_upper_bound=bound_mm)
        known, nearest = np.isfinite(to_sample), np.asarray(samples)
        distances = np.full(len(points_mm), np.inf)
        offset = points_mm[known] - self._surface_mm[nearest[known]]
        size = np.abs(np.einsum("ij,ij->i", offset, self._normals[nearest[known]]))
        distances[known] = np.copysign(size, self._tumour.height_mm(points_mm[known]))
        return distances

    def _lowest_points(self, tumor_from_tip: Transform) -> FloatArray:
        """Points of the tool, in the tumour's frame, that include the lowest and the nearest one.

        Heights and distances are at least the distance to the origin minus the maximum radius, and
        the minimum of either is at most the height of any point.
        """
        points = tumor_from_tip.apply(self._tool_mm)
        upper_mm = float(self._tumour.height_mm(points[::_COARSE]).min())
        beyond_mm = np.linalg.norm(points, axis=1) - self._max_radius_mm
        return np.asarray(points[beyond_mm <= max(upper_mm, 0.0)])


def dense_surface(triangles_mm: FloatArray, spacing_mm: float) -> FloatArray:
    """Sample triangles (m, 3, 3) as points (n, 3), corners included, ``spacing_mm`` apart at most.

    Every triangle is halved at its longest edge until that edge is short enough.
    """
    done, open_triangles = [], triangles_mm
    while len(open_triangles):
        lengths = np.linalg.norm(np.roll(open_triangles, -1, axis=1) - open_triangles, axis=2)
        fits = lengths.max(axis=1) <= spacing_mm
        done.append(open_triangles[fits].reshape(-1, 3))
        halved, longest = open_triangles[~fits], lengths[~fits].argmax(axis=1)
        order = (longest[:, None] + np.arange(3)) % 3
        first, second, apex = np.moveaxis(halved[np.arange(len(halved))[:, None], order], 1, 0)
        middle = 0.5 * (first + second)
        open_triangles = np.concatenate(
            [np.stack([first, middle, apex], axis=1), np.stack([middle, second, apex], axis=1)]
        )
    return np.unique(np.concatenate(done), axis=0)
