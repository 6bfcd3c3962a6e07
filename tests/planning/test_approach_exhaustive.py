"""The check of approaches by coal, with 500 queries for each robot."""

import numpy as np
import pytest

from app.planning import ApproachError
from tests.planning.approach_scenes import load, random_problem
from tests.planning.test_approach import CLEARANCE_MM, ROBOTS, excess_mm

pytestmark = pytest.mark.exhaustive


@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", ROBOTS)
def test_coal_finds_every_clearance_kept_of_500_queries(name):
    robot, rng = load(name), np.random.default_rng(11)
    found = 0
    for _ in range(500):
        structures, start, goal, _ = random_problem(robot, rng, CLEARANCE_MM)
        try:
            excess, pair = excess_mm(robot, structures, start, goal)
        except ApproachError:
            continue
        found += 1
        assert excess > -1e-6, pair
    assert found >= 300  # UR5: goals behind structures are often out of the search's reach
