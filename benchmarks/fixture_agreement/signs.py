"""Whether the engine says inside where the judge does."""

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.fixture import ProximityEngine
from app.geometry import FloatArray
from benchmarks.fixture_agreement.pairs import Pair
from benchmarks.fixture_agreement.poses import PoseSource
from benchmarks.fixture_oracle import Oracle, Relation

NEAR_MM = 0.05
"""Nearer to the surface than this, rounding decides: such a sign is not judged."""

_GRAZING_MM = 0.5
_SUBDIVISIONS = 3


@dataclass(frozen=True, eq=False)
class Signs:
    """Counts over some poses of one pair, and the poses (n, 4, 4) whose sign was wrong.

    ``relations`` counts what the judge says of each pose, ``grazing`` the poses within 0.5 mm of
    touching (by ours), ``judged`` those beyond 0.05 mm.
    """

    poses: int
    judged: int
    grazing: int
    relations: Counter[Relation]
    wrong: list[FloatArray]

    def __add__(self, other: "Signs") -> "Signs":
        return Signs(
            self.poses + other.poses,
            self.judged + other.judged,
            self.grazing + other.grazing,
            self.relations + other.relations,
            self.wrong + other.wrong,
        )


def signs(pair: Pair, poses: int, seed: int) -> Signs:
    """Judge so many poses of a pair, the tumour of some 1000 triangles."""
    engine, oracle, source = _built(pair)
    rng = np.random.default_rng([1, pair.number, seed])
    relations: Counter[Relation] = Counter()
    judged, grazing, wrong = 0, 0, []
    for pose in source.draw(rng, poses):
        distance = engine.evaluate(pose).signed_distance_mm
        relation = oracle.relation(pose)
        relations[relation] += 1
        grazing += abs(distance) < _GRAZING_MM
        # A number that is none is judged, and wrong.
        if abs(distance) <= NEAR_MM:
            continue
        judged += 1
        if not (distance > 0.0 if relation is Relation.APART else distance < 0.0):
            wrong.append(pose.matrix)
    return Signs(poses, judged, int(grazing), relations, wrong)


@lru_cache(maxsize=1)
def _built(pair: Pair) -> tuple[ProximityEngine, Oracle, PoseSource]:
    meshes = pair.meshes(_SUBDIVISIONS)
    return ProximityEngine(*meshes), Oracle.of(*meshes), PoseSource.of(*meshes)
