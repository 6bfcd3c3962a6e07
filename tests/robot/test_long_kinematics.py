"""100 configurations of each robot of example-robot-data, compared with Pinocchio."""

import pytest

from tests.oracles.pinocchio_kinematics import assert_example_robots_agree

pytestmark = pytest.mark.long


def test_example_robots_agree_with_pinocchio(example_robots, rng):
    assert_example_robots_agree(rng, 100)
