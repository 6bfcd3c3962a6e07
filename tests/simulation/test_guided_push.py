"""A push of a simulated hand: stopped by the fixture in physics, and not without it."""

import pytest

from tests.fixture.control.push_simulation import MARGINS
from tests.simulation.guided_push import Pushes

pytestmark = pytest.mark.long


def test_fixture_stops_the_push_and_a_push_without_it_breaches():
    pushes = Pushes()
    without, guided = pushes.run(3, fixture=False), pushes.run(3, fixture=True)
    assert without.lowest_mm < 0.0
    assert MARGINS.stop_mm <= guided.lowest_mm < 6.0
    assert guided.stops == 0
    assert without.retreat_mm_s == pytest.approx(100.0, rel=0.05)  # the hand's
    # Close to the tumour the free motion slows every motion down.
    assert 20.0 < guided.retreat_mm_s < without.retreat_mm_s
