"""A short run of the agreement benchmark, and checks of its oracle."""

import numpy as np
import pytest

from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from benchmarks.fixture_agreement.crossings import crossings
from benchmarks.fixture_agreement.distances import distances
from benchmarks.fixture_agreement.pairs import PAIRS, Pair
from benchmarks.fixture_agreement.poses import PoseSource
from benchmarks.fixture_agreement.signs import signs
from benchmarks.fixture_oracle import Oracle, Relation
from benchmarks.fixture_shapes import tool, tumor

NEEDLE, BLOCK = PAIRS[0], PAIRS[2]


@pytest.mark.parametrize("pair", [NEEDLE, BLOCK], ids=lambda pair: pair.name)
def test_engine_signs_match_the_oracle(pair: Pair) -> None:
    found = signs(pair, 150, 0) + signs(pair, 50, 1)
    assert found.wrong == []
    assert found.poses == found.relations.total() == 200
    # All relations occur often: one inside the other, intersecting, apart, grazing.
    nested = Relation.TOOL_INSIDE if pair is NEEDLE else Relation.TUMOR_INSIDE
    assert found.relations[nested] > 40
    assert found.relations[Relation.MEETING] > 40
    assert found.relations[Relation.APART] > 10
    assert found.grazing > 40


def test_wrong_sign_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    right = ProximityEngine.evaluate

    def shifted(engine: ProximityEngine, pose: Transform) -> object:
        moved = Transform(
            pose.target, pose.source, pose.rotation, pose.translation_mm + np.array([2.0, 0.0, 0.0])
        )
        return right(engine, moved)

    monkeypatch.setattr(ProximityEngine, "evaluate", shifted)
    assert signs(NEEDLE, 100, 0).wrong


def test_distances_and_bounds_match_the_oracle() -> None:
    found = distances(NEEDLE, 2, 0) + distances(NEEDLE, 2, 1)
    assert found.poses == 4
    assert found.rms_mm <= 0.02
    assert found.max_mm <= 0.1
    assert found.above_bound == 0


def test_every_crossing_is_detected() -> None:
    found = crossings(20)
    assert (found.count, found.caught, found.confirmed) == (20, 20, 20)


def test_oracle_gives_the_depth_of_a_ball_inside_a_ball() -> None:
    ball = tumor("ball", 4)
    small = SurfaceMesh("tool", 0.1 * ball.vertices_mm, ball.faces)
    oracle = Oracle.of(ball, small)
    for x, expected in ((14.0, 3.0), (10.5, -0.5), (6.0, -5.0)):
        pose = Transform("tumor", "tool", np.eye(3), np.array([x, 0.0, 0.0]))
        # A faceted ball is up to 0.02 mm smaller than a round one.
        assert oracle.signed_distance_mm(pose) == pytest.approx(expected, abs=0.05)


def test_grazing_poses_bring_surfaces_into_contact() -> None:
    meshes = tumor("ball", 3), tool("needle")
    poses = PoseSource.of(*meshes).draw(np.random.default_rng(0), 200)
    oracle = Oracle.of(*meshes)
    apart = [pose for pose in poses if oracle.relation(pose) is Relation.APART]
    near = [pose for pose in apart if oracle.signed_distance_mm(pose, 0.1) < 0.5]
    assert len(near) > 15
