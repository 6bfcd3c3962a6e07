"""Places where a needle may enter the skin, and points that its tip may reach."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, InputError, SurfaceMesh
from app.planning.corridor_distance import closed_surface, needle_distances

ENTRIES = 100_000
"""Candidates of a surface or a disc, unless another number is given."""

_INNER_GRID = 12
"""Points along each side of a structure's box, of which those inside are candidates."""


@dataclass(frozen=True, slots=True, eq=False)
class EntryRegion:
    """Candidates of the entry: ``points_mm`` (n, 3) and outward ``normals`` (n, 3) of the skin.

    Both are in ``frame``; the normals get length 1. Raises `InputError` for an empty region, other
    shapes, numbers that are not finite and normals of length 0.
    """

    frame: str
    points_mm: FloatArray
    normals: FloatArray

    def __post_init__(self) -> None:
        points = points_of(self.points_mm, "entry region")
        normals = points_of(self.normals, "normals of the entry region")
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        if len(normals) != len(points) or not (lengths > 0.0).all():
            raise InputError(
                f"entry region: has {int((lengths > 0.0).sum())} normals for {len(points)} points; "
                "expected one for each, not of length 0"
            )
        normals = normals / lengths
        normals.flags.writeable = False
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "normals", normals)

    @classmethod
    def of_surface(
        cls,
        skin: SurfaceMesh,
        *,
        box_mm: tuple[ArrayLike, ArrayLike] | None = None,
        count: int = ENTRIES,
    ) -> "EntryRegion":
        """About ``count`` points spread evenly over ``skin``, at least one on each face.

        ``box_mm`` (lowest and highest corner) keeps the points within it. The skin need not be
        closed; its normals point outward.
        """
        corners = skin.triangles_mm
        low, high = np.full(3, -math.inf), np.full(3, math.inf)
        if box_mm is not None:
            low, high = points_of(np.stack([np.asarray(each) for each in box_mm]), "entry box")
            touched = (corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)
            corners = corners[touched.all(axis=1)]
        crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(crossed, axis=1)
        corners, normals, area = corners[area > 0.0], crossed[area > 0.0], area[area > 0.0]
        parts = _divisions(corners, count)
        points = [np.empty((0, 3))]
        owners = [np.empty(0, dtype=np.intp)]
        for k in np.unique(parts):
            faces = np.flatnonzero(parts == k)
            weights = _centers_of_parts(int(k))
            points.append(np.einsum("ki,fij->fkj", weights, corners[faces]).reshape(-1, 3))
            owners.append(np.repeat(faces, len(weights)))
        found, owner = np.concatenate(points), np.concatenate(owners)
        inside = ((found >= low) & (found <= high)).all(axis=1)
        # In the order of the faces, so that candidates that follow each other are near.
        order = np.flatnonzero(inside)[np.argsort(owner[inside], kind="stable")]
        return cls(skin.frame, found[order], normals[owner[order]])

    @classmethod
    def of_disc(
        cls,
        frame: str,
        center_mm: ArrayLike,
        normal: ArrayLike,
        radius_mm: float,
        *,
        count: int = ENTRIES,
    ) -> "EntryRegion":
        """``count`` points spread evenly over a disc, by Vogel's spiral (1979)."""
        center, axis = points_of(np.stack([np.asarray(center_mm), np.asarray(normal)]), "disc")
        if not (math.isfinite(radius_mm) and radius_mm > 0.0 and np.linalg.norm(axis) > 0.0):
            raise InputError(
                f"disc: has radius {radius_mm} mm and normal {axis.tolist()}; expected a radius "
                "above 0 and a normal that is not 0"
            )
        u, v = np.linalg.svd(axis[None])[2][1:]
        rank = np.arange(count)
        distance = radius_mm * np.sqrt((rank + 0.5) / count)
        turn = rank * math.pi * (3.0 - math.sqrt(5.0))
        offsets = distance[:, None] * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
        order = np.lexsort(((offsets @ u) // (radius_mm / 50.0), (offsets @ v) // (radius_mm / 50)))
        return cls(frame, (center + offsets)[order], np.tile(axis, (count, 1)))

    @classmethod
    def of_segment(
        cls, frame: str, ends_mm: ArrayLike, normal: ArrayLike, *, count: int = ENTRIES
    ) -> "EntryRegion":
        """``count`` points spread evenly over the segment between ``ends_mm`` (2, 3)."""
        points = points_on_segment(ends_mm, count)
        axis = np.asarray(normal, dtype=np.float64)
        return cls(frame, points, np.broadcast_to(axis, points.shape))


@dataclass(frozen=True, slots=True, eq=False)
class NeedleTarget:
    """Points (m, 3) that the tip may reach, in ``frame``, and the ``centrality`` (m,) of each.

    Centrality is 1 at the best place and 0 at the edge of a structure. Raises `InputError` for no
    points, numbers that are not finite and a centrality that is not from 0 to 1.
    """

    frame: str
    points_mm: FloatArray
    centrality: FloatArray

    def __post_init__(self) -> None:
        points = points_of(self.points_mm, "target")
        centrality = np.array(self.centrality, dtype=np.float64)
        if centrality.shape != (len(points),) or not ((centrality >= 0) & (centrality <= 1)).all():
            raise InputError(
                f"target: centrality is {centrality.tolist()}; expected 0 to 1 for each of "
                f"{len(points)} points"
            )
        centrality.flags.writeable = False
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "centrality", centrality)

    @classmethod
    def of_points(
        cls, frame: str, points_mm: ArrayLike, within: SurfaceMesh | None = None
    ) -> "NeedleTarget":
        """Given points, each as good as the others.

        Raises `InputError` for a point that is not inside the structure ``within``.
        """
        points = points_of(points_mm, "target")
        if within is not None:
            surface = closed_surface(within, "the target's mesh")
            outside = needle_distances(surface, points, points)
            if outside.max() >= 0.0:
                place = points[outside.argmax()].round(3).tolist()
                raise InputError(
                    f"target: {place} mm is {outside.max():.3g} mm outside of its structure; "
                    "expected a point inside"
                )
        return cls(frame, points, np.ones(len(points)))

    @classmethod
    def of_structure(cls, surface: SurfaceMesh, *, count: int = 5) -> "NeedleTarget":
        """The deepest point of a structure, its centroid and others inside, ``count`` at most.

        They are of a grid, spread evenly. The centrality is the depth as a share of the largest
        one. A centroid outside is left out.
        """
        closed = closed_surface(surface, "the target's mesh")
        low, high = surface.bounds_mm
        ticks = [np.linspace(low[k], high[k], _INNER_GRID + 2)[1:-1] for k in range(3)]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
        points = np.concatenate([surface.centroid_mm[None], grid])
        depth = -needle_distances(closed, points, points)
        points, depth = points[depth > 0.0], depth[depth > 0.0]
        if not len(points):
            raise InputError("target: no point inside was found; expected a thicker structure")
        chosen = [int(depth.argmax())]
        if chosen != [0] and (points[0] == surface.centroid_mm).all():
            chosen.append(0)
        gap = depth
        for number in range(min(count, len(points))):
            if number == len(chosen):
                chosen.append(int(gap.argmax()))
            away = np.linalg.norm(points - points[chosen[number]], axis=1)
            gap = np.minimum(gap, away)
        return cls(surface.frame, points[chosen], depth[chosen] / depth.max())


def points_of(points_mm: ArrayLike, what: str) -> FloatArray:
    """``points_mm`` as a new read-only array (n, 3); raises `InputError` if it is none."""
    try:
        points = np.array(points_mm, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: is no array of numbers; expected shape (n, 3)") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{what}: has shape {points.shape}; expected (n, 3)")
    if not len(points):
        raise InputError(f"{what}: is empty; expected at least one point")
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        raise InputError(
            f"{what}: point {wrong[0]} is {points[wrong[0]].tolist()}; expected finite numbers"
        )
    points.flags.writeable = False
    return points


def points_on_segment(ends_mm: ArrayLike, count: int) -> FloatArray:
    """``count`` points (n, 3) spread evenly over the segment between ``ends_mm`` (2, 3)."""
    ends = points_of(ends_mm, "segment")
    if len(ends) != 2 or count < 2:
        raise InputError(f"segment: has {len(ends)} ends, {count} points; expected 2 ends or more")
    return np.asarray(np.linspace(ends[0], ends[1], count))


def _divisions(corners: FloatArray, count: int) -> NDArray[np.int64]:
    """For each face (f,) the number of parts of each side, so that about ``count`` parts arise."""
    if not len(corners):
        return np.empty(0, dtype=np.int64)
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    low, high = 0.0, float(sides.max())  # of the length of a part
    for _ in range(40):
        middle = 0.5 * (low + high)
        if middle <= 0.0 or (np.ceil(sides / middle) ** 2).sum() > count:
            low = middle
        else:
            high = middle
    return np.asarray(np.ceil(sides / high), dtype=np.int64)


def _centers_of_parts(k: int) -> FloatArray:
    """Barycentric coordinates (k^2, 3) of the centroids of the k^2 parts of a triangle."""
    i, j = (each.ravel() for each in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
    upright, inverted = i + j < k, i + j < k - 1
    first = np.concatenate([i[upright] + 1.0 / 3.0, i[inverted] + 2.0 / 3.0]) / k
    second = np.concatenate([j[upright] + 1.0 / 3.0, j[inverted] + 2.0 / 3.0]) / k
    return np.stack([first, second, 1.0 - first - second], axis=1)
