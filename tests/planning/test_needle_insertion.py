"""A robot inserts a needle to a breathing target, in the simulation, and the vessel moves.

Insertions that reach the target: `test_many_needle_insertions`.
"""

import pytest

from tests.planning.needle_insertion import operation

pytestmark = pytest.mark.slow


def test_vessel_that_moves_into_the_way_stops_the_needle():
    found = operation().insert(0, vessel_moves=True)
    assert found.path_mm < 0.0  # it is in the way
    assert found.lateral_mm is None
    assert 20.0 < found.left_mm < 80.0
    assert found.vessel_mm > 0.0
