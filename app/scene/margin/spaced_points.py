"""Points of which no two are nearer to each other than a distance."""

from itertools import product
from math import dist, floor

Point = list[float]

_NEIGHBOURS = tuple(product((-1, 0, 1), repeat=3))


class SpacedPoints:
    """At most ``max_count`` points in mm, at least ``spacing_mm`` apart, in their order.

    Above ``max_count`` points ``spacing_mm`` is doubled and points nearer than that to an earlier
    one are removed: each point that was ever added has one of these within twice the spacing.
    """

    def __init__(self, spacing_mm: float, max_count: int) -> None:
        self.points: list[Point] = []
        self.spacing_mm = spacing_mm
        self._max_count = max_count
        self._cells: dict[tuple[int, ...], list[Point]] = {}

    def add(self, point: Point) -> bool:
        """Add ``point`` (3,) in mm; False if another one is too near."""
        cell = [floor(value / self.spacing_mm) for value in point]
        for offset in _NEIGHBOURS:
            near = tuple(a + b for a, b in zip(cell, offset, strict=True))
            if any(dist(point, other) < self.spacing_mm for other in self._cells.get(near, ())):
                return False
        self._cells.setdefault(tuple(cell), []).append(point)
        self.points.append(point)
        while len(self.points) > self._max_count:
            self._thin()
        return True

    def _thin(self) -> None:
        points, self.points = self.points, []
        self._cells.clear()
        self.spacing_mm *= 2.0
        for point in points:
            self.add(point)
