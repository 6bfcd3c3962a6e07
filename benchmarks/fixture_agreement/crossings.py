"""Detection of a tumour between two poses by a sweep."""

from dataclasses import dataclass

import numpy as np

from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from benchmarks.fixture_oracle import Oracle
from benchmarks.fixture_shapes import tool, tumor

_PATH_MM = 40.0
"""The distance between two poses at 1 m/s and 25 Hz."""


@dataclass(frozen=True)
class Crossings:
    """Numbers of crossings: tried, detected by a sweep, confirmed as contact by the oracle."""

    count: int
    caught: int
    confirmed: int


def small_tumor() -> SurfaceMesh:
    """A ball of 1 mm diameter."""
    ball = tumor("ball", 2)
    return SurfaceMesh(ball.frame, 0.05 * ball.vertices_mm, ball.faces)


def crossing(rng: np.random.Generator) -> tuple[Transform, Transform]:
    """A path of 40 mm straight through the small tumour with a rotation, outside at both ends.

    The needle's origin, a point inside it, passes the tumour's centre at up to 0.3 mm.
    """
    direction, rotation = rng.normal(size=3), rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    fraction = rng.uniform(0.3, 0.7)
    normal = np.cross(direction, rotation)
    offset = 0.3 * rng.uniform() * normal / np.linalg.norm(normal)
    first = Transform.from_rotation_vector(
        rotation, offset - _PATH_MM * fraction * direction, target="tumor", source="tool"
    )
    last = Transform.from_rotation_vector(
        rotation + 0.2 * rng.normal(size=3),
        offset + _PATH_MM * (1.0 - fraction) * direction,
        target="tumor",
        source="tool",
    )
    return first, last


def crossings(count: int, seed: int = 7) -> Crossings:
    """Sweep ``count`` random crossings, whose ends are outside of the tumour."""
    meshes = small_tumor(), tool("needle", 8)
    engine, oracle = ProximityEngine(*meshes), Oracle.of(*meshes)
    rng = np.random.default_rng(seed)
    caught = confirmed = 0
    for _ in range(count):
        first, last = crossing(rng)
        if oracle.overlaps(first) or oracle.overlaps(last):
            raise ValueError("crossing: an end is inside the tumour; expected both outside")
        found = engine.sweep(first, last)
        if found.lowest.signed_distance_mm <= 0.0:
            caught += 1
            confirmed += oracle.overlaps(first.interpolate(last, found.fraction))
    return Crossings(count, caught, int(confirmed))
