"""Depth of 1000 simulated breaches of each jitter: bias, and coverage of the 95 % interval."""

import pytest

from tests.analysis.simulated_breaches import DepthErrors

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(3600)]


@pytest.mark.parametrize(
    ("kind", "lowest", "highest"),
    [
        ("white", 0.93, 0.97),
        ("correlated", 0.93, 0.97),
        ("mixed", 0.87, 0.97),  # slow jitter resembles the motion of a hand
    ],
)
def test_estimate_has_no_bias_and_its_interval_covers_the_depth(kind, lowest, highest):
    found = DepthErrors.over(kind, 1000)
    assert abs(found.bias_mm) <= 0.05
    assert lowest <= found.coverage <= highest
