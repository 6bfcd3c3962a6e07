"""Truth of a motion without noise: the signed distance of the tool from the tumour, and breaches.

The distance is independent of the engine under test: its sign comes from the tumour's radius
function and its size from a dense sampling of the analytic surface, neither from the mesh nor from
a collision library.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.synthetic.height_kernel import ROUNDING_MM, heights_of_tool
from app.synthetic.motion import Poses
from app.synthetic.tumour_and_tool import NEAR_PART_MM, Tumour, icosphere

NEAR_SPACING_MM = 0.4
"""Maximum distance between samples of the blade and the shaft."""

HANDLE_SPACING_MM = 4.0
"""Maximum distance between samples of the handle, which never comes near the tumour."""

SURFACE_SUBDIVISIONS = 6
"""40 962 samples of the tumour's surface, about 0.3 mm apart."""

_SLOPE_SAFETY = 0.95
_MAX_UNSAMPLED_MM = 0.05
"""Largest rise of a lobe between samples that are 0.3 mm apart."""
_BLOCK = 64
_BATCH_OUTSIDE, _BATCH_INSIDE = 16, 2
"""Points of the first search. Inside, each search is slow and leaves few points."""
TRAVEL_STEP_S = 0.02
TRAVEL_SAFETY = 2.0
"""The travel of the tool is summed over chords of `TRAVEL_STEP_S` and multiplied by this."""
MIN_STEP_S = 0.0005
"""Minimum step: a shorter contact may be missed."""
DEPTH_STEP_S = 0.005
_DISTANCE_ERROR_MM = 0.05
"""Error of two distances by `Clearance`, which samples both surfaces."""
Motion = Callable[[float], Transform]
"""Maps a time in s from the first frame to ``tumor_from_tip``."""
PosesAt = Callable[[FloatArray], Poses]
"""Maps times (n,) in s from the first frame to n poses."""


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
        # Without the two options a query of a point deep inside takes four times as long.
        self._tree = cKDTree(self._surface_mm, 32, compact_nodes=False, balanced_tree=False)
        self._tool, self._tool_mm = tool, _tool_points(tool)
        self._lowest = 0  # of the last pose: the next one has a low height there, too
        self.tool_length_mm = -float(tool.bounds_mm[0][2])
        radii = np.linalg.norm(self._surface_mm, axis=1)
        self._max_radius_mm = float(radii.max()) + _MAX_UNSAMPLED_MM
        slope = float(np.einsum("ij,ij->i", self._normals, directions).min())
        self.distance_per_height = _SLOPE_SAFETY * slope
        """Lower bound of distance over height: the cosine of the steepest slope."""

    def height_mm(self, tumor_from_tip: Transform) -> float:
        """The minimum height over the tool: negative exactly when the tool is in the tumour."""
        return self._heights(tumor_from_tip, for_distance=False)[0]

    def distance_mm(self, tumor_from_tip: Transform) -> float:
        """The minimum signed distance over the tool."""
        lowest, heights = self._heights(tumor_from_tip, for_distance=True)
        near = np.isfinite(heights)
        points, heights = tumor_from_tip.apply(self._tool_mm[near]), heights[near]
        lower_bounds = np.where(heights > 0.0, self.distance_per_height * heights, heights)
        best, size = np.inf, _BATCH_INSIDE if lowest < 0.0 else _BATCH_OUTSIDE
        # In ascending order of the bounds, until no other point can be deeper or nearer.
        while len(points):
            count, size = min(size, len(points)), 2 * size
            order = np.argpartition(lower_bounds, count - 1)
            batch, rest = order[:count], order[count:]
            # Outside, the search of a point stops at the distance of the best one.
            bound_mm = best if best > 0.0 else np.inf
            distances, samples = self._point_distances_mm(points[batch], heights[batch], bound_mm)
            best = min(best, float(distances.min()))
            points, heights, lower_bounds = points[rest], heights[rest], lower_bounds[rest]
            if best < 0.0 and len(points):
                # A point is no deeper than its distance to any sample of the surface.
                depths = cdist(points, self._surface_mm[samples]).min(axis=1)
                lower_bounds = np.maximum(lower_bounds, -depths - ROUNDING_MM)
            possible = lower_bounds <= best
            points, heights = points[possible], heights[possible]
            lower_bounds = lower_bounds[possible]
        return best

    def point_distances_mm(self, points_mm: FloatArray) -> FloatArray:
        """The signed distance (n,) of points (n, 3) in the tumour's frame."""
        heights = self._tumour.height_mm(points_mm)
        return self._point_distances_mm(points_mm, heights, np.inf)[0]

    def _point_distances_mm(
        self, points_mm: FloatArray, heights_mm: FloatArray, bound_mm: float
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """Signed distances (n,) of points (n, 3) with these heights, and the samples (k,) used.

        The distance is infinite for points without a sample of the surface within ``bound_mm``.
        """
        to_sample, nearest = self._tree.query(points_mm, distance_upper_bound=bound_mm)
        known = np.isfinite(to_sample)
        samples = np.asarray(nearest, dtype=np.intp)[known]
        distances = np.full(len(points_mm), np.inf)
        offset = points_mm[known] - self._surface_mm[samples]
        size = np.abs(np.einsum("ij,ij->i", offset, self._normals[samples]))
        distances[known] = np.copysign(size, heights_mm[known])
        return distances, samples

    def _heights(
        self, tumor_from_tip: Transform, *, for_distance: bool
    ) -> tuple[float, FloatArray]:
        """The minimum height over the tool, and the heights (n,) of its points.

        Those are infinite for most points that cannot be the lowest nor, ``for_distance``, the
        nearest one.
        """
        heights = np.empty(len(self._tool_mm))
        tumour = self._tumour
        self._lowest = heights_of_tool(
            self._tool_mm,
            tumor_from_tip.rotation,
            tumor_from_tip.translation_mm,
            tumour.semi_axes_mm,
            tumour.lobe_centres,
            tumour.lobe_heights,
            tumour.lobe_sharpness,
            self._max_radius_mm,
            *_blocks(self._tool),
            self.distance_per_height,
            for_distance,
            self._lowest,
            heights,
        )
        return float(heights[self._lowest]), heights


@lru_cache(maxsize=1)
def _tool_points(tool: SurfaceMesh) -> FloatArray:
    """Samples (n, 3) of the tool's surface, in an order in which neighbours follow each other."""
    handle = (tool.triangles_mm[:, :, 2] < -NEAR_PART_MM).all(axis=1)
    points = [
        dense_surface(tool.triangles_mm[~handle], NEAR_SPACING_MM),
        dense_surface(tool.triangles_mm[handle], HANDLE_SPACING_MM),
    ]
    samples = np.concatenate(points)
    return samples[cKDTree(samples, leafsize=_BLOCK).indices]


@lru_cache(maxsize=1)
def _blocks(tool: SurfaceMesh) -> tuple[int, FloatArray, FloatArray]:
    """Blocks of successive samples of the tool: size, centres (k, 3) and radii (k,) of spheres."""
    samples = _tool_points(tool)
    blocks = [samples[first : first + _BLOCK] for first in range(0, len(samples), _BLOCK)]
    centres = np.array([0.5 * (each.min(axis=0) + each.max(axis=0)) for each in blocks])
    radii = np.array(
        [cdist(each, place[None]).max() for each, place in zip(blocks, centres, strict=True)]
    )
    return _BLOCK, centres, radii + ROUNDING_MM


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


@dataclass(frozen=True, slots=True)
class TrueBreach:
    """An interval in which the tool is in the tumour, and its minimum signed distance.

    ``tip_clearance_mm``: minimum signed distance of the tip alone, negative when it is inside.
    """

    start_s: float
    end_s: float
    min_signed_distance_mm: float
    tip_clearance_mm: float

    @property
    def shaft_only(self) -> bool:
        """True if the tip stays outside the tumour."""
        return self.tip_clearance_mm > 0.0


def find_breaches(
    clearance: Clearance,
    tumor_from_tip: Motion,
    duration_s: float,
    poses_at: PosesAt | None = None,
) -> tuple[TrueBreach, ...]:
    """Find every breach of a motion from 0 to ``duration_s``.

    ``poses_at`` are the poses of ``tumor_from_tip`` at many times at once, which takes less time.
    Steps by conservative advancement: at a distance ``d`` there is no contact before the tool has
    travelled ``d``. The sign of the height is exact, so a root finder gives each crossing. A breach
    at the start or end of the motion begins or ends there.
    """

    def height(time_s: float) -> float:
        return clearance.height_mm(tumor_from_tip(time_s))

    at_all = poses_at or (lambda times_s: Poses.of([tumor_from_tip(t) for t in times_s.tolist()]))
    times = np.linspace(0.0, duration_s, int(np.ceil(duration_s / TRAVEL_STEP_S)) + 1)
    travel_mm = _travelled(at_all(times), clearance.tool_length_mm)
    crossings: list[float] = []
    time_s, here = 0.0, height(0.0)
    if here < 0.0:
        crossings.append(0.0)
    while time_s < duration_s:
        safe_mm = clearance.distance_per_height * abs(here) / TRAVEL_SAFETY
        reach_mm = float(np.interp(time_s, times, travel_mm)) + safe_mm
        safe_until_s = float(times[np.searchsorted(travel_mm, reach_mm, side="right") - 1])
        later_s = min(max(safe_until_s, time_s + MIN_STEP_S), duration_s)
        later = height(later_s)
        if (later < 0.0) != (here < 0.0):
            crossings.append(float(brentq(height, time_s, later_s, xtol=1e-7)))
        time_s, here = later_s, later
    if here < 0.0:
        crossings.append(duration_s)
    found = []
    for start_s, end_s in zip(crossings[::2], crossings[1::2], strict=True):
        count = max(3, int(np.ceil((end_s - start_s) / DEPTH_STEP_S)) + 1)
        times = np.linspace(start_s, end_s, count)
        poses = at_all(times)
        deepest, depth_mm = _deepest(clearance, poses)
        refined = minimize_scalar(
            lambda t: clearance.distance_mm(tumor_from_tip(t)),
            bounds=(times[max(deepest - 1, 0)], times[min(deepest + 1, count - 1)]),
            method="bounded",
        )
        tip_mm = float(clearance.point_distances_mm(poses.translations_mm).min())
        found.append(TrueBreach(start_s, end_s, min(float(refined.fun), depth_mm), tip_mm))
    return tuple(found)


def _travelled(poses: Poses, length_mm: float) -> FloatArray:
    """The travel (n,) up to each pose of that end of the tool which moves more.

    Points of the axis between the ends travel no farther; the safety factor covers the others, a
    few mm off the axis.
    """
    positions = poses.apply(np.array([(0.0, 0.0, 0.0), (0.0, 0.0, -length_mm)]))
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _deepest(clearance: Clearance, all_poses: Poses) -> tuple[int, float]:
    """The first pose with the lowest distance, and that distance.

    Intervals are halved. Between two poses the distance is no lower than the mean of both minus
    half of the travel, so that an interval above the lowest distance is left out.
    """
    reach_mm = TRAVEL_SAFETY * _travelled(all_poses, clearance.tool_length_mm)
    poses = all_poses.transforms()
    found = {end: clearance.distance_mm(poses[end]) for end in (0, len(poses) - 1)}
    best, intervals = min(found.values()), [(0, len(poses) - 1)]
    while intervals:
        first, last = intervals.pop()
        bound = 0.5 * (found[first] + found[last] - float(reach_mm[last] - reach_mm[first]))
        if last - first > 1 and bound <= best + _DISTANCE_ERROR_MM:
            middle = (first + last) // 2
            found[middle] = clearance.distance_mm(poses[middle])
            best = min(best, found[middle])
            intervals += [(middle, last), (first, middle)]
    return min((number for number, depth in found.items() if depth == best)), best
