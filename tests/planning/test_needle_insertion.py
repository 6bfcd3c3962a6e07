"""A robot inserts a needle to a breathing target, in the simulation: one insertion of each kind."""

import pytest

from tests.planning.needle_insertion import STOP_MM, operation, predicted_mm

pytestmark = pytest.mark.slow


def test_needle_reaches_the_breathing_target_past_the_vessel():
    corridor = operation().corridor
    assert corridor.depth_mm > 80.0
    found = operation().insert(2)
    assert found.lateral_mm is not None
    assert found.lateral_mm <= predicted_mm(0.999)
    assert found.waited_s > 0.5
    assert found.vessel_mm > STOP_MM


def test_vessel_that_moves_into_the_way_stops_the_needle():
    found = operation().insert(0, vessel_moves=True)
    assert found.path_mm < 0.0  # it is in the way
    assert found.lateral_mm is None
    assert 20.0 < found.left_mm < 80.0
    assert found.vessel_mm > 0.0
