"""Agreement of the engine's sign with the oracle."""

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
"""Signs nearer to the surface than this depend on rounding and are not evaluated."""

_GRAZING_MM = 0.5
_SUBDIVISIONS = 3


@dataclass(frozen=True, eq=False)
class Signs:
    """Counts over some poses of one pair, and the poses (n, 4, 4) with a wrong sign.

    ``relations`` counts the oracle's results, ``grazing`` the poses within 0.5 mm of contact by our
    engine, ``judged`` those beyond 0.05 mm, whose sign is compared.
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
    """Evaluate ``poses`` poses of a pair, with a tumour of at least 1280 triangles."""
    engine, oracle, source = _built(pair)
    rng = np.random.default_rng([1, pair.number, seed])
    relations: Counter[Relation] = Counter()
    judged, grazing, wrong = 0, 0, []
    for pose in source.draw(rng, poses):
        distance = engine.evaluate(pose).signed_distance_mm
        relation = oracle.relation(pose)
        relations[relation] += 1
        grazing += abs(distance) < _GRAZING_MM
        # NaN passes this test and counts as wrong below.
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
