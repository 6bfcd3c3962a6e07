"""Statistics on many samples; the suite has the same on fewer."""

import numpy as np
import pytest

from app.analysis import Jitter, estimate_depth
from tests.analysis.test_breach_probability import check_calibration
from tests.analysis.test_depth import check_bias, check_coverage_of_turns

pytestmark = pytest.mark.exhaustive


def test_probabilities_of_2000_simulated_cases_are_calibrated():
    check_calibration(2000, brier_abs=0.015, share=0.03)


@pytest.mark.parametrize("kind", ["white", "correlated"])
def test_estimate_is_less_biased_than_the_lowest_sample(kind):
    check_bias(kind, 40)


def test_interval_holds_the_depth_of_a_tool_that_turns_fast():
    check_coverage_of_turns(60, 0.8)


def test_breach_of_9_seconds_is_evaluated_in_three_parts():
    times = np.arange(0.0, 9.0, 0.02)
    truth = -1.0 - np.exp(-0.5 * ((times - 6.0) / 0.5) ** 2)
    noisy = truth + np.random.default_rng(2).normal(0.0, 0.3, len(times))
    found = estimate_depth(times, noisy, Jitter(0.3), start_s=0.0, end_s=8.98)
    assert found.low_mm <= -2.0 <= found.high_mm
    assert found.distance_mm == pytest.approx(-2.0, abs=0.25)
