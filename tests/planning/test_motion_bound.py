"""The bound of a motion: a pair is proven free only if it keeps its clearance all the way."""

import math

import numpy as np
import pytest

from app.planning import CollisionModel
from app.planning.collision_bodies import _hull_of
from app.planning.collision_distance import _are_apart, find_nearer
from app.planning.collision_kernel import _set_range
from tests.planning.approach_scenes import load, random_queries, random_structures

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


@pytest.mark.parametrize("thickness_mm", [10.0, 1e-9, 1e-10, 1e-12, 0.0])
def test_hull_of_a_plate_reaches_as_far_as_its_points(thickness_mm):
    rng, angles = np.random.default_rng(5), np.linspace(0.0, math.tau, 1000)
    wavy = thickness_mm * np.cos(7.0 * angles)
    disc = np.column_stack([100.0 * np.cos(angles), 100.0 * np.sin(angles), wavy])
    inner = disc * [[0.5, 0.5, 0.0]]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.concatenate([disc, inner]) @ turn + 50.0
    hull, ways = _hull_of(points), rng.normal(size=(2000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    assert ((points @ ways.T).max(axis=0) - (hull @ ways.T).max(axis=0)).max() < 1e-9
    assert len(hull) < len(points)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_plane_proves_no_motion_that_is_not_finite(number):
    robot = load("touch")
    structures = random_structures(robot, np.random.default_rng(6), 1)
    bodies = CollisionModel(robot, (), {}, structures, clearance_mm=1.0, carried={})._arrays
    rows, still = [tuple(row) for row in np.eye(3).tolist()], (0.0, 0.0, 0.0)
    for place, motion, apart in (
        (1e4, (still, still, 0.0, 0.0), True),
        (number, (still, still, 0.0, 0.0), False),
        (1e4, ((0.0, number, 0.0), still, 0.0, 0.0), False),
        (1e4, (still, (number, 0.0, 0.0), 0.0, 0.0), False),
        (1e4, (still, still, number, 0.0), False),
    ):
        shift = (place, 0.0, 0.0)
        assert _are_apart(bodies, 0, 0, (*rows, shift), motion, 1.0) == apart
