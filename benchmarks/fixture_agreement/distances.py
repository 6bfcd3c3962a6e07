"""Errors of the engine's distances against a densely sampled tool."""

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
    """Sum of squared errors in mm^2 and maximum error in mm, over some poses of one pair.

    ``above_bound`` is the number of poses whose lower bound is above the oracle's distance.
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
    """Evaluate ``poses`` poses of a pair, with a tumour of at least 20480 triangles.

    Poses with the tumour inside the tool are skipped, as the oracle samples the tool's surface.
    """
    engine, oracle, source = _built(pair)
    rng = np.random.default_rng([2, pair.number, seed])
    errors: list[float] = []
    above = 0
    while len(errors) < poses:
        for pose in source.draw(rng, poses - len(errors)):
            if oracle.tool_contains_tumor(pose):
                continue
            found, sampled = engine.evaluate(pose), oracle.signed_distance_mm(pose)
            errors.append(found.signed_distance_mm - sampled)
            # NaN counts as above.
            above += not found.lower_bound_mm <= sampled
    squares = np.square(errors)
    return Distances(poses, float(squares.sum()), float(np.sqrt(squares.max())), above)


@lru_cache(maxsize=1)
def _built(pair: Pair) -> tuple[ProximityEngine, Oracle, PoseSource]:
    meshes = pair.meshes(_SUBDIVISIONS)
    return ProximityEngine(*meshes), Oracle.of(*meshes), PoseSource.of(*meshes)
