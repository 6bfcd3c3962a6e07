"""Whether a sweep catches a tumour that lies between two poses."""

from dataclasses import dataclass

import numpy as np

from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from benchmarks.fixture_oracle import Oracle
from benchmarks.fixture_shapes import tool, tumor

_WAY_MM = 40.0
"""What 1 m/s is from one pose to the next at 25 Hz."""


@dataclass(frozen=True)
class Crossings:
    """How many were tried, caught by a sweep, and found in contact there by the judge."""

    count: int
    caught: int
    confirmed: int


def small_tumor() -> SurfaceMesh:
    """A ball of 1 mm."""
    ball = tumor("ball", 2)
    return SurfaceMesh(ball.frame, 0.05 * ball.vertices_mm, ball.faces)


def crossing(rng: np.random.Generator) -> tuple[Transform, Transform]:
    """40 mm straight through the small tumour with a turn, the needle clear of it at both ends.

    The needle's origin, a point within it, comes to 0.3 mm of the tumour's middle.
    """
    way, turn = rng.normal(size=3), rng.normal(size=3)
    way /= np.linalg.norm(way)
    share = rng.uniform(0.3, 0.7)
    across = np.cross(way, turn)
    aside = 0.3 * rng.uniform() * across / np.linalg.norm(across)
    first = Transform.from_rotation_vector(
        turn, aside - _WAY_MM * share * way, target="tumor", source="tool"
    )
    last = Transform.from_rotation_vector(
        turn + 0.2 * rng.normal(size=3),
        aside + _WAY_MM * (1.0 - share) * way,
        target="tumor",
        source="tool",
    )
    return first, last


def crossings(count: int, seed: int = 7) -> Crossings:
    """Sweep so many random crossings; each end alone is clear of the tumour."""
    meshes = small_tumor(), tool("needle", 8)
    engine, oracle = ProximityEngine(*meshes), Oracle.of(*meshes)
    rng = np.random.default_rng(seed)
    caught = confirmed = 0
    for _ in range(count):
        first, last = crossing(rng)
        if oracle.overlaps(first) or oracle.overlaps(last):
            raise ValueError("a crossing that begins or ends in the tumour shows nothing")
        found = engine.sweep(first, last)
        if found.lowest.signed_distance_mm <= 0.0:
            caught += 1
            confirmed += oracle.overlaps(first.interpolate(last, found.fraction))
    return Crossings(count, caught, int(confirmed))
