"""The deepest point of the tool on the straight path between measured poses.

The tool is not measured between two frames. On a straight path with the shortest rotation its
signed distance changes by at most the length that one of its points travels, so the distances at
the ends of a piece of the path bound it in between. The piece with the lowest bound is divided
until the bound is close to the lowest distance that was evaluated (Piyavskii 1972, Shubert 1972).
"""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import NamedTuple

from app.fixture import Proximity, path_mm
from app.geometry import InputError, Stamp, Transform

_NEAREST_END = 0.1
"""A piece is divided at least this fraction of its length from its ends."""


class PathPoint(NamedTuple):
    """Pose ``tumor_from_tip`` of the tool at ``stamp``, and its proximity there."""

    stamp: Stamp
    tumor_from_tip: Transform
    proximity: Proximity


@dataclass(frozen=True, slots=True, eq=False)
class PathDepth:
    """The deepest point of a path.

    ``deepest`` is the estimate: the evaluated pose with the lowest distance, and the time at which
    a tool at constant speed between two frames is there. ``lower_bound_mm`` is never above the
    distance at any pose of the path. ``end`` is the last point of the path.
    """

    deepest: PathPoint
    lower_bound_mm: float
    end: PathPoint

    @property
    def proximity(self) -> Proximity:
        """The proximity of `deepest`, with the lower bound of the whole path."""
        return replace(self.deepest.proximity, lower_bound_mm=self.lower_bound_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    start: PathPoint
    end: PathPoint
    length_mm: float
    bound_mm: float

    @classmethod
    def between(cls, start: PathPoint, end: PathPoint, radius_mm: float) -> "_Piece":
        length = path_mm(start.tumor_from_tip, end.tumor_from_tip, radius_mm)
        low, other = start.proximity.lower_bound_mm, end.proximity.lower_bound_mm
        return cls(start, end, length, min(low, other, 0.5 * (low + other - length)))

    def divided_at(self) -> float:
        """The fraction at which the bounds from both ends meet, away from the ends."""
        if self.length_mm <= 0.0:
            return 0.5
        fall = self.start.proximity.lower_bound_mm - self.end.proximity.lower_bound_mm
        return min(max(0.5 + 0.5 * fall / self.length_mm, _NEAREST_END), 1.0 - _NEAREST_END)


def deepest_on_path(
    points: Sequence[PathPoint],
    evaluate: Callable[[Transform], Proximity],
    *,
    radius_mm: float,
    tolerance_mm: float,
    max_evaluations: int,
) -> PathDepth:
    """Search the path through ``points``, in the order of time, for its deepest point.

    ``evaluate`` gives the proximity at a pose; ``radius_mm`` is the extent of the tool around its
    origin. Ends when the bound is within ``tolerance_mm`` of the estimate, or after
    ``max_evaluations``; the bound then states what may have been missed. Raises `InputError`
    without a point.
    """
    if not points:
        raise InputError("points of a path: there are 0; expected at least 1")
    order = count()  # pieces with one bound are divided in the order of their creation
    pieces: list[tuple[float, int, _Piece]] = []

    def add(start: PathPoint, end: PathPoint) -> None:
        piece = _Piece.between(start, end, radius_mm)
        heapq.heappush(pieces, (piece.bound_mm, next(order), piece))

    deepest = min(points, key=_distance_mm)
    for start, end in pairwise(points):
        add(start, end)
    for _ in range(max_evaluations):
        if not pieces or pieces[0][0] >= _distance_mm(deepest) - tolerance_mm:
            break
        _, _, piece = heapq.heappop(pieces)
        middle = point_between(piece.start, piece.end, piece.divided_at(), evaluate)
        if _distance_mm(middle) < _distance_mm(deepest):
            deepest = middle
        add(piece.start, middle)
        add(middle, piece.end)
    bounds = [point.proximity.lower_bound_mm for point in (deepest, *points)]
    return PathDepth(deepest, min([*bounds, *(bound for bound, _, _ in pieces[:1])]), points[-1])


def point_between(
    start: PathPoint, end: PathPoint, fraction: float, evaluate: Callable[[Transform], Proximity]
) -> PathPoint:
    """The point at ``fraction`` (0 to 1) of the straight path, with its time and proximity."""
    pose = start.tumor_from_tip.interpolate(end.tumor_from_tip, fraction)
    duration_ns = start.stamp.age_ns(end.stamp)
    stamp = Stamp(start.stamp.ns + round(fraction * duration_ns), start.stamp.clock)
    return PathPoint(stamp, pose, evaluate(pose))


def _distance_mm(point: PathPoint) -> float:
    return point.proximity.signed_distance_mm
