"""Coverage of the tumour's surface: how near the tool came to each part and side of it.

The distance is that of places on the tumour's surface to the tool's surface, which is taken as
points at most `SPACING_MM` apart; it is too large by at most ``SPACING_MM^2 / (8 x)`` at a distance
``x``. A place is the centre of a face, or of a part of one: large faces are divided, so that the
places are spread alike over a coarse surface and a fine one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.analysis.samples import CaseSamples
from app.geometry import ANATOMICAL_WORDS, FloatArray, SurfaceMesh

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from app.analysis.case_breaches import AnalysedBreach

WITHIN_MM = (1.0, 2.0, 5.0, 10.0)
SPACING_MM = 0.7
MAX_PLACES = 1500
"""Limit on places; of a surface with more, those that are spread over it stand for all of them."""
_AT_ONCE = 50_000
"""Intervals of poses that are halved in one step: some 20 MB."""
SIDES = "RLAPSI"


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Least distances of the tool to the places (m,) on the tumour's surface.

    ``faces`` (m,): index of the face of each place; a large face has several. ``places_mm`` (m, 3).
    ``nearest_mm`` (m,): least distance of the tool to each of them, up to the largest of
    `WITHIN_MM`, infinite beyond. ``areas_mm2`` (m,): of the part of the face around each place.
    ``frames``: how many were used.
    """

    faces: NDArray[np.intp]
    places_mm: FloatArray
    nearest_mm: FloatArray
    areas_mm2: FloatArray
    frames: int

    def share(self, within_mm: float) -> float:
        """Share of the surface, 0 to 1, that the tool came nearer to than ``within_mm``."""
        near = self.nearest_mm <= within_mm
        return float(self.areas_mm2[near].sum() / self.areas_mm2.sum())

    def shares(self) -> Mapping[float, float]:
        """The share within each distance of `WITHIN_MM`."""
        return {within: self.share(within) for within in WITHIN_MM}


def surface_points(surface: SurfaceMesh, spacing_mm: float = SPACING_MM) -> FloatArray:
    """Points (k, 3) of ``surface``: each of its points is at most ``spacing_mm`` from one."""
    points = [surface.vertices_mm]
    corners = surface.triangles_mm
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    pieces = np.maximum(1, np.ceil(longest / spacing_mm)).astype(int)
    for count in np.unique(pieces[pieces > 1]).tolist():
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        kept = i + j <= count
        weights = np.stack([i[kept], j[kept], count - i[kept] - j[kept]], axis=1) / count
        points.append((weights @ corners[pieces == count]).reshape(-1, 3))
    return np.unique(np.round(np.concatenate(points), 6), axis=0)


def surface_places(
    surface: SurfaceMesh, max_places: int
) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """At most ``max_places`` places (m, 3) on ``surface``, their faces (m,) and areas (m,).

    A face of more than its part of the area, of twice as many places, is divided into alike parts.
    """
    corners = surface.triangles_mm
    sides = corners[:, 1:] - corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    parts = np.ceil(np.sqrt(2.0 * max_places * areas / areas.sum()) - 1e-9)
    parts = np.maximum(parts, 1.0).astype(int)
    faces, places = [], []
    for count in np.unique(parts).tolist():
        chosen = np.flatnonzero(parts == count)
        weights = _part_centres(count)
        faces.append(np.repeat(chosen, len(weights)))
        places.append((weights @ corners[chosen]).reshape(-1, 3))
    face, place = np.concatenate(faces), np.concatenate(places)
    order = np.argsort(face, kind="stable")
    face, place = face[order], place[order]
    kept = spread_faces(place, max_places)
    face = face[kept]
    return face, place[kept], areas[face] / parts[face] ** 2


def _part_centres(count: int) -> FloatArray:
    """Barycentric coordinates (count^2, 3) of the centres of alike parts of a triangle."""
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    up, down = i + j < count, i + j < count - 1
    first = np.concatenate([i[up] + 1.0 / 3.0, i[down] + 2.0 / 3.0]) / count
    second = np.concatenate([j[up] + 1.0 / 3.0, j[down] + 2.0 / 3.0]) / count
    return np.stack([first, second, 1.0 - first - second], axis=1)


def spread_faces(centres_mm: FloatArray, max_faces: int) -> NDArray[np.intp]:
    """At most ``max_faces`` indices of ``centres_mm`` (m, 3), increasing, spread over all of them.

    The order of a mesh's faces often has a pattern, which every n-th face would follow. So every
    n-th face of the order of a k-d tree is taken, in which neighbours follow each other.
    """
    from scipy.spatial import cKDTree  # slow to load

    every = -(-len(centres_mm) // max_faces)
    if every == 1:
        return np.arange(len(centres_mm))
    return np.sort(cKDTree(centres_mm, leafsize=max(1, every)).indices[every // 2 :: every])


def coverage_of(samples: CaseSamples, tumor: SurfaceMesh, tool: SurfaceMesh | None) -> Coverage:
    """Least distances of the tool to places on ``tumor`` in the frames whose distance is known.

    ``tool`` is in the tip's frame; None is a tool that is its tip alone.
    """
    from scipy.spatial import cKDTree  # slow to load

    faces, centres, areas = surface_places(tumor, MAX_PLACES)
    limit = max(WITHIN_MM)
    frames = near_frames(samples, limit)
    nearest = np.full(len(centres), np.inf)
    if len(frames) and tool is None:  # the nearest of the places of one point
        tips = cKDTree(samples.tips_mm[frames])
        found, _ = tips.query(centres, distance_upper_bound=limit)
        nearest = np.asarray(found, dtype=np.float64)
    elif len(frames) and tool is not None:
        tree = cKDTree(surface_points(tool))
        nearest = _nearest(tree, samples.tips_mm[frames], samples.rotations[frames], centres)
    return Coverage(faces, centres, nearest, areas, len(frames))


def _nearest(
    tool: "cKDTree", tips: FloatArray, rotations: FloatArray, points: FloatArray
) -> FloatArray:
    """Least distance (m,) of ``points`` (m, 3) to the points of ``tool`` at any of its poses.

    Infinite beyond the largest of `WITHIN_MM`. Intervals of poses are halved unless the motion
    within them is too short for a smaller distance than is known. Those that may hold the smallest
    distances are halved first, at most `_AT_ONCE` at a time, which bounds the memory.
    """
    limit = max(WITHIN_MM)
    way = np.append(0.0, np.cumsum(_largest_motions(tips, rotations, points)))
    nearest = np.full(len(points), np.inf)

    def distances(point: NDArray[np.intp], pose: NDArray[np.intp]) -> FloatArray:
        """At most ``limit``, of each point (k,) at a pose; updates ``nearest``."""
        in_tip = np.einsum("kji,kj->ki", rotations[pose], points[point] - tips[pose])
        found, _ = tool.query(in_tip, distance_upper_bound=limit)
        np.minimum.at(nearest, point, found)
        return np.minimum(found, limit)

    point = np.arange(len(points))
    first, last = np.zeros_like(point), np.full_like(point, len(tips) - 1)
    left = [(point, first, last, distances(point, first), distances(point, last))]
    while left:
        point, first, last, at_first, at_last = left.pop()
        lowest = 0.5 * (at_first + at_last - (way[last] - way[first]))
        kept = np.flatnonzero((last - first > 1) & (lowest < np.minimum(nearest[point], limit)))
        if len(kept) > _AT_ONCE:
            kept = kept[np.argpartition(lowest[kept], _AT_ONCE)]
            later = kept[_AT_ONCE:]
            left.append((point[later], first[later], last[later], at_first[later], at_last[later]))
            kept = kept[:_AT_ONCE]
        if len(kept) == 0:
            continue
        point, first, last = point[kept], first[kept], last[kept]
        at_first, at_last = at_first[kept], at_last[kept]
        middle = (first + last) // 2
        at_middle = distances(point, middle)
        left.append(
            (
                np.concatenate([point, point]),
                np.concatenate([first, middle]),
                np.concatenate([middle, last]),
                np.concatenate([at_first, at_middle]),
                np.concatenate([at_middle, at_last]),
            )
        )
    return nearest


def _largest_motions(tips: FloatArray, rotations: FloatArray, points: FloatArray) -> FloatArray:
    """Largest motion of ``points`` in the tip's frame between two poses, as a bound, (n - 1,)."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    in_tip = np.einsum("nji,nj->ni", rotations, middle - tips)
    turned = np.linalg.norm(np.diff(rotations, axis=0), axis=(1, 2))
    return np.asarray(np.linalg.norm(np.diff(in_tip, axis=0), axis=1) + turned * radius)


def near_frames(samples: CaseSamples, limit_mm: float) -> NDArray[np.intp]:
    """Frames with a pose in which the tool is not farther from the tumour than ``limit_mm``."""
    with np.errstate(invalid="ignore"):
        near = np.isfinite(samples.tips_mm).all(axis=1) & (samples.distances_mm <= limit_mm)
    return np.flatnonzero(near)


@dataclass(frozen=True, slots=True)
class SideResult:
    """One side, the faces whose direction from the centroid is nearest to one of six directions.

    ``area_mm2``: of the faces. ``nearest_mm``: least distance of the tool to those that `Coverage`
    uses, None if it is above the largest of `WITHIN_MM`. ``shares``: of their area that the tool
    came nearer to than each of `WITHIN_MM`, None without such a face. ``breaches``: how many.
    ``margin_mm``: closest margin of the specimen, None without one.
    """

    side: str
    area_mm2: float
    nearest_mm: float | None
    shares: Mapping[str, float | None]
    breaches: int
    margin_mm: float | None


def sides_of_surface(
    tumor: SurfaceMesh, ras_from_tumor: FloatArray | None = None
) -> NDArray[np.str_]:
    """The letter of the side of each face (m,) of ``tumor``, seen from its centroid."""
    centres = tumor.triangles_mm.mean(axis=1) - tumor.centroid_mm
    turned = centres if ras_from_tumor is None else centres @ ras_from_tumor.T
    axis = np.abs(turned).argmax(axis=1)
    positive = np.take_along_axis(turned, axis[:, None], axis=1)[:, 0] > 0.0
    return np.asarray(np.array(list(SIDES))[2 * axis + np.where(positive, 0, 1)])


def side_results(
    tumor: SurfaceMesh,
    coverage: Coverage,
    breaches: "Sequence[AnalysedBreach]",
    margins_mm: Mapping[str, float],
    ras_from_tumor: FloatArray | None = None,
) -> tuple[SideResult, ...]:
    """The results of the six sides; ``margins_mm`` are those of the specimen, empty without one."""
    letters = sides_of_surface(tumor, ras_from_tumor)
    corners = tumor.triangles_mm
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    sides = []
    for letter in SIDES:
        chosen = letters[coverage.faces] == letter
        around, nearest = coverage.areas_mm2[chosen], coverage.nearest_mm[chosen]
        sampled = float(around.sum())
        word = ANATOMICAL_WORDS[letter]
        least = float(nearest.min(initial=np.inf))
        shares = {
            f"within_{within:g}_mm": float(around[nearest <= within].sum()) / sampled
            if sampled > 0.0
            else None
            for within in WITHIN_MM
        }
        sides.append(
            SideResult(
                word,
                float(areas[letters == letter].sum()),
                least if np.isfinite(least) else None,
                shares,
                sum(breach.side == word for breach in breaches),
                margins_mm.get(letter),
            )
        )
    return tuple(sides)
