"""Statistics on many samples; the suite has the same on fewer."""

import pytest

from tests.analysis.test_breach_probability import check_calibration
from tests.analysis.test_depth import check_bias, check_coverage_of_turns, check_long_breach

pytestmark = pytest.mark.exhaustive


def test_probabilities_of_2000_simulated_cases_are_calibrated():
    check_calibration(2000, brier_abs=0.015, share=0.03)


@pytest.mark.parametrize("kind", ["white", "correlated"])
def test_estimate_is_less_biased_than_the_lowest_sample(kind):
    check_bias(kind, 40)


def test_interval_holds_the_depth_of_a_tool_that_turns_fast():
    check_coverage_of_turns(60, 0.8)


def test_breach_of_9_seconds_is_evaluated_in_three_parts():
    check_long_breach(9.0, 6.0)
