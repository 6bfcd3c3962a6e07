"""Ten pushes of a simulated hand with the fixture, and the same ten without it."""

import pytest

from tests.fixture.control.push_simulation import MARGINS
from tests.simulation.guided_push import Pushes

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1800)]


def test_fixture_stops_every_push_and_every_push_without_it_breaches():
    pushes = Pushes()
    for seed in range(10):
        assert pushes.run(seed, fixture=False).lowest_mm < MARGINS.stop_mm, seed
        assert pushes.run(seed, fixture=True).lowest_mm >= MARGINS.stop_mm, seed
