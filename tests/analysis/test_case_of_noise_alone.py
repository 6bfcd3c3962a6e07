"""The analysis of a simulated case whose only error is white noise: what an interval is of."""

import pytest

import marginguard as mg
from app.analysis import analyse_case


@pytest.mark.timeout(300)
def test_depths_cover_the_truth_and_are_nearer_than_the_lowest_samples(tmp_path):
    case = mg.open_case(mg.make_case(tmp_path / "case", seed=1))
    content = case.content
    found = analyse_case(
        mg.replay(case), name=content.name, margins=content.margins, tumor=content.tumor
    )
    expected = case.case.expected()
    assert expected is not None and expected.breaches is not None
    truths = [breach.min_signed_distance_mm for breach in expected.breaches.intervals]
    assert len(found.breaches) == len(truths) == 3
    for breach, truth in zip(found.breaches, truths, strict=True):
        assert breach.estimate is not None
        assert breach.estimate.low_mm <= truth <= breach.estimate.high_mm
        error_mm = abs(breach.estimate.distance_mm - truth)
        assert error_mm < 0.5 * abs(breach.lowest_sample_mm - truth)
