"""The analysis of whole cases: the shipped one, and one whose only error is white noise."""

import pytest

import marginguard as mg
from tests.analysis.test_case_analysis import analysed, check_breaches, check_figures
from tests.shipped_case import FRAMES

pytestmark = pytest.mark.long


def test_shipped_case_has_its_breaches_and_the_figures_of_its_report():
    case = mg.open_case(mg.example_case())
    found = analysed(case, mg.replay(case))
    check_breaches(case, found)
    check_figures(found, FRAMES)


@pytest.mark.timeout(300)
def test_depths_cover_the_truth_and_are_nearer_than_the_lowest_samples(tmp_path):
    case = mg.open_case(mg.make_case(tmp_path / "case", seed=1))
    found = analysed(case, mg.replay(case))
    expected = case.case.expected().breaches
    truths = [breach.min_signed_distance_mm for breach in expected.intervals]
    assert len(found.breaches) == len(truths) == 3
    for breach, truth in zip(found.breaches, truths, strict=True):
        assert breach.estimate is not None
        assert breach.estimate.low_mm <= truth <= breach.estimate.high_mm
        error_mm = abs(breach.estimate.distance_mm - truth)
        assert error_mm < 0.5 * abs(breach.lowest_sample_mm - truth)
