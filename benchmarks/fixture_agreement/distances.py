"""How far the engine's distances are from those of a densely sampled tool."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.fixture import ProximityEngine
from benchmarks.fixture_agreement.pairs import Pair
from benchmarks.fixture_agreement.poses import PoseSource
from benchmarks.fixture_oracle import Oracle

_SUBDIVISIONS = 5


@dataclass(frozen=True)
class Distances:
    """Sums over some poses of one pair: squared errors in mm^2, the largest error in mm.

    ``above_bound`` counts the poses whose lower bound was above the judge's distance.
    """

    poses: int
    squared_mm2: float
    max_mm: float
    above_bound: int

    def __add__(self, other: "Distances") -> "Distances":
        return Distances(
            self.poses + other.poses,
            self.squared_mm2 + other.squared_mm2,
            max(self.max_mm, other.max_mm),
            self.above_bound + other.above_bound,
        )

    @property
    def rms_mm(self) -> float:
        """The root of the mean of the squared errors."""
        return float(np.sqrt(self.squared_mm2 / self.poses))


def distances(pair: Pair, poses: int, seed: int) -> Distances:
    """Judge so many poses of a pair, the tumour of 20480 triangles and more.

    A tumour in the tool is passed over: the judge's distance is that of the tool's surface.
    """
    engine, oracle, source = _built(pair)
    rng = np.random.default_rng([2, pair.number, seed])
    errors: list[float] = []
    above = 0
    while len(errors) < poses:
        for pose in source.draw(rng, poses - len(errors)):
            if oracle.tool_holds_tumor(pose):
                continue
            found, sampled = engine.evaluate(pose), oracle.signed_distance_mm(pose)
            errors.append(found.signed_distance_mm - sampled)
            # A bound that is no number is above too.
            above += not found.lower_bound_mm <= sampled
    squares = np.square(errors)
    return Distances(poses, float(squares.sum()), float(np.sqrt(squares.max())), above)


@lru_cache(maxsize=1)
def _built(pair: Pair) -> tuple[ProximityEngine, Oracle, PoseSource]:
    meshes = pair.meshes(_SUBDIVISIONS)
    return ProximityEngine(*meshes), Oracle.of(*meshes), PoseSource.of(*meshes)
