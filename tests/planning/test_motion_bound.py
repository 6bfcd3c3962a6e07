"""The bound of a motion: a pair is proven free only if it keeps its clearance all the way."""

import math

import numpy as np
import pytest

from app.planning import CollisionModel
from app.planning.collision_distance import find_nearer
from app.planning.collision_kernel import _set_range
from tests.planning.approach_scenes import load, random_queries

pytestmark = pytest.mark.slow


def set_range(model, middle, half):
    scratch, count = model._scratch, len(model.joints)
    scratch.middle[:count], scratch.half[:count] = middle, half
    _set_range(model._arrays, model._arm, scratch)
    return scratch


@pytest.mark.parametrize("name", ["touch", "ur5", "panda"])
def test_points_stay_within_the_way_and_the_bend_of_their_body(name):
    robot, rng = load(name), np.random.default_rng(3)
    joints = robot.actuated_joint_names  # of the Panda the sliding fingers, too
    model = CollisionModel(robot, joints, {}, {}, clearance_mm=1.0, carried={})
    closest = 0.0
    for number in range(60):
        size = 10.0 ** rng.uniform(-2.0, 0.0) * (1.0 if number % 2 else rng.random(len(joints)))
        middle = rng.uniform(-1.5, 1.5, len(joints))
        half = size * (1.0 if number % 4 > 1 else rng.choice([-1.0, 1.0], len(joints)))
        scratch = set_range(model, middle, half * np.ones(len(joints)))
        matrices, twists = scratch.matrices.copy(), scratch.twists.copy()
        for t in (-1.0, -0.5, 0.5, 1.0):
            model._pose(middle + t * half)
            for body, (link, each) in enumerate(zip(model._arrays.link, model.moving, strict=True)):
                count = len(model._movers(body))
                if count == 0:
                    continue
                turn, way, (bend, longest) = np.split(twists[body, count - 1], [3, 6])
                now, then = (m[link, :3] for m in (matrices, scratch.matrices))
                points = each.bvh.corners[:, 0]
                moved = (points @ then[:, :3].T + then[:, 3] - now[:, 3]) @ now[:, :3] - points
                off = np.linalg.norm(moved - t * (way + np.cross(turn, points)), axis=1).max()
                assert off <= bend * t * t + 1e-9
                assert np.linalg.norm(moved, axis=1).max() <= longest * abs(t) + 1e-9
                closest = max(closest, off / (bend * t * t + 1e-9))
    assert closest > 0.6  # the bound is not much larger than needed


@pytest.mark.parametrize("name", ["ur5"])
def test_pair_that_comes_nearer_than_its_clearance_is_not_proven(name):
    rng = np.random.default_rng(4)
    _, _, model = random_queries(load(name), rng, 1.0)
    pairs, count = model._pairs, len(model.joints)
    proven = tested = 0
    for number in range(100):
        size = 10.0 ** rng.uniform(-2.0, 0.0)
        middle, half = rng.uniform(-1.5, 1.5, count), rng.uniform(-size, size, count)
        k = number % len(pairs.bodies)
        (a, b), joints = pairs.bodies[k].tolist(), pairs.joints[k].tolist()
        distances = []
        for t in np.linspace(-1.0, 1.0, 21):
            model._pose(middle + t * half)
            distances.append(model._distance_mm(a, b))
        if min(distances) == 0.0:
            continue
        scratch = set_range(model, middle, half)
        too_much, half_of_it = (
            find_nearer(model._arrays, a, b, clearance_mm, *joints, False, scratch)
            for clearance_mm in (min(distances) + 1e-6, 0.5 * min(distances))
        )
        assert too_much < math.inf
        tested += 1
        proven += half_of_it == math.inf
    assert tested > 40
    assert proven > tested // 4
