"""Depth of 300 breaches with each jitter at each rate: bias, coverage and width of the interval."""

import pytest

from tests.analysis.simulated_breaches import DepthErrors

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]


_SLOW = pytest.mark.xfail(
    strict=True, reason="recorded at 15 Hz, interpolated to 100: taken for motion, 0.1 mm too deep"
)


@pytest.mark.parametrize(
    ("kind", "rate_hz"),
    [
        pytest.param(kind, rate, marks=[_SLOW] if (kind, rate) == ("recorded", 100.0) else [])
        for kind in ("white", "correlated", "slow", "pink", "recorded")
        for rate in (20.0, 40.0, 100.0)
    ],
)
def test_interval_holds_the_depth(kind, rate_hz):
    """300 breaches show a coverage of 0.95 within 0.025; the interval may be too wide."""
    found = DepthErrors.over(kind, 300, rate_hz)
    assert abs(found.bias_mm) <= 0.05 + 2.0 * found.standard_error_mm
    assert found.coverage >= 0.925
    assert found.width_ratio <= 1.6
