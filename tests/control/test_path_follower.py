"""The follower of a path at random rates: on the path, within the accelerations, to its end."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from app.control import PathFollower, PlannedMotion
from app.geometry import InputError
from app.planning.path_timing import time_path

pytestmark = pytest.mark.slow

MS = 1_000_000
PERIOD_NS = 5 * MS


def motion_of(states: np.ndarray, limits: np.ndarray) -> PlannedMotion:
    """The motion through ``states`` (k, d) within velocity, acceleration and jerk (3, d)."""
    joints = tuple(f"joint{number}" for number in range(states.shape[1]))
    return PlannedMotion("robot", joints, {}, *time_path(states, limits), limits[1], "setup")


def random_motion(rng: np.random.Generator) -> tuple[np.ndarray, PlannedMotion]:
    count = int(rng.integers(1, 7))
    states = rng.uniform(-1.0, 1.0, (int(rng.integers(2, 6)), count))
    limits = np.array([[1.5], [4.0], [40.0]]) * rng.uniform(0.3, 2.0, (3, count))
    return states, motion_of(states, limits)


def distance_from(states: np.ndarray, place: np.ndarray) -> float:
    """Distance from the straight lines between ``states``."""
    found = []
    for start, end in pairwise(states):
        line = end - start
        along = np.clip((place - start) @ line / (line @ line), 0.0, 1.0)
        found.append(np.linalg.norm(start + along * line - place))
    return float(min(found))


def speeds(places: list[np.ndarray]) -> np.ndarray:
    return np.diff(places, axis=0) / (PERIOD_NS * 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_joints_keep_path_speed_and_acceleration_at_any_rate(seed):
    rng = np.random.default_rng(seed)
    states, motion = random_motion(rng)
    follower = PathFollower(motion)
    places, share = [follower.positions] * 2, 1.0
    for _ in range(20_000):
        if rng.random() < 0.03:
            share = float(rng.choice([0.0, 1.0, rng.random()]))
        before = follower.progress
        places.append(follower.step(share, PERIOD_NS))
        assert follower.progress >= before
        if follower.progress == 1.0:
            break
    assert follower.progress == 1.0
    np.testing.assert_array_equal(places[-1], states[-1])
    assert max(distance_from(states, place) for place in places) < 1e-9
    velocities = speeds([*places, places[-1]])
    # The velocity of the plan between two of its samples is that of a cubic curve.
    assert (np.abs(velocities).max(axis=0) <= 1.001 * np.abs(motion.velocities).max(axis=0)).all()
    accelerations = np.diff(velocities, axis=0) / (PERIOD_NS * 1e-9)
    assert (np.abs(accelerations) <= 1.1 * motion.accelerations).all()


@pytest.mark.parametrize("seed", range(4))
def test_stop_takes_no_longer_than_announced(seed):
    rng = np.random.default_rng(seed)
    _, motion = random_motion(rng)
    follower = PathFollower(motion)
    while follower.progress < rng.uniform(0.2, 0.8):
        follower.step(1.0, PERIOD_NS)
    steps = 0
    while follower.rate > 0.0 and follower.planned_velocities.any():
        follower.step(0.0, PERIOD_NS)
        steps += 1
    assert steps * PERIOD_NS * 1e-9 <= follower.stop_s + 0.02
    place = follower.positions
    follower.step(0.0, PERIOD_NS)
    np.testing.assert_array_equal(follower.positions, place)


def test_undisturbed_motion_takes_the_planned_time():
    motion = motion_of(np.array([[0.0], [0.3], [0.0]]), np.array([[1.0], [5.0], [50.0]]))
    follower, steps = PathFollower(motion), 0
    while follower.progress < 1.0:
        follower.step(1.0, PERIOD_NS)
        steps += 1
    assert steps * PERIOD_NS == motion.times_ns[-1]


def test_motion_that_could_not_stop_in_half_a_second_is_slower():
    motion = motion_of(np.array([[0.0], [9.0]]), np.array([[3.0], [2.0], [50.0]]))
    follower = PathFollower(motion)
    assert follower.stop_s == pytest.approx(0.5)
    places = [follower.step(1.0, PERIOD_NS) for _ in range(1500)]
    assert speeds(places).max() == pytest.approx(0.5 * 2.0, rel=1e-3)


def test_motion_that_rests_at_both_ends_is_as_fast_between_them_as_its_joint():
    ends = np.array([0, 3000 * MS]), np.array([[0.0], [1.5]]), np.zeros((2, 1))
    motion = PlannedMotion("robot", ("joint0",), {}, *ends, np.array([1.0]), "setup")
    assert motion.fastest == pytest.approx(0.75)
    for limit in (1.0, 0.3):
        follower = PathFollower(motion, np.array([limit]))
        places = [follower.step(1.0, PERIOD_NS) for _ in range(2000)]
        assert follower.progress == 1.0
        assert speeds(places).max() == pytest.approx(min(limit, 0.5), rel=1e-3)


def test_late_step_does_not_jump():
    motion = motion_of(np.array([[0.0], [1.0]]), np.array([[1.0], [5.0], [50.0]]))
    follower = PathFollower(motion)
    for _ in range(100):
        before = follower.step(1.0, PERIOD_NS)
    assert follower.step(1.0, 500 * MS) - before <= 1.001 * 0.02


def test_motion_without_a_way_is_at_its_end():
    motion = motion_of(np.array([[0.5], [0.5]]), np.array([[1.0], [5.0], [50.0]]))
    follower = PathFollower(motion)
    assert follower.progress == 1.0
    assert follower.step(1.0, PERIOD_NS).tolist() == [0.5]


def test_motion_that_leaves_its_lines_is_refused():
    motion = motion_of(np.array([[0.0, 0.0], [1.0, 1.0]]), np.ones((3, 2)) * [[1.0], [5.0], [50.0]])
    moved = motion.positions.copy()
    moved[30, 0] += 1e-3
    for change, problem in (
        ({"positions": moved}, "moves off the lines"),
        ({"velocities": motion.velocities[::-1] - 0.1}, "moves off the lines"),
        ({"times_ns": motion.times_ns[::-1]}, "do not increase from 0"),
        ({"positions": motion.positions[:-1]}, "has arrays"),
        ({"positions": np.full_like(motion.positions, np.nan)}, "NaN"),
        ({"positions": 1e200 * motion.positions}, "more than 1e"),
        ({"accelerations": np.zeros(2)}, "a limit of 0"),
        ({"held": {"joint1": 0.0}}, "names a joint twice"),
        ({"times_ns": motion.times_ns[:, None]}, "has arrays"),
        ({"velocities": 0.0 * motion.velocities}, "exceeds its accelerations"),
        ({"times_ns": 2 * motion.times_ns}, "moves back between its samples"),
        ({"positions": 3.0 * motion.positions}, "exceeds its accelerations"),
        ({"accelerations": 0.5 * motion.accelerations}, "exceeds its accelerations"),
    ):
        with pytest.raises(InputError, match=problem):
            replace(motion, **change)
