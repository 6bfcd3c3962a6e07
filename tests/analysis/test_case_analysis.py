"""The analysis of the shipped case, whose truth is known."""

import json

import pytest

import marginguard as mg
from app.analysis import CaseAnalysis, analyse_case
from app.geometry import InputError
from tests.shipped_case import FRAMES


@pytest.fixture(scope="module")
def case() -> mg.PreparedCase:
    return mg.open_case(mg.example_case())


@pytest.fixture(scope="module")
def analysis(case: mg.PreparedCase) -> CaseAnalysis:
    content = case.content
    return analyse_case(
        mg.replay(case), name=content.name, margins=content.margins, tumor=content.tumor
    )


def test_depths_are_within_the_tolerance_of_the_case_and_higher_than_the_lowest_samples(
    case, analysis
):
    """Calibration and contour have errors, which an interval of the noise does not contain."""
    expected = case.case.expected()
    assert expected is not None and expected.breaches is not None
    truths = [breach.min_signed_distance_mm for breach in expected.breaches.intervals]
    assert len(analysis.breaches) == len(truths) == 3
    for breach, truth in zip(analysis.breaches, truths, strict=True):
        assert breach.estimate is not None
        assert breach.estimate.low_mm < breach.estimate.distance_mm < breach.estimate.high_mm
        error_mm = abs(breach.estimate.distance_mm - truth)
        assert error_mm < expected.breaches.depth_tolerance_mm
        assert breach.lowest_sample_mm < breach.estimate.distance_mm


def test_part_of_the_tool_is_that_of_the_script(case, analysis):
    expected = case.case.expected()
    assert expected is not None and expected.breaches is not None
    parts = ["shaft" if breach.shaft_only else "tip" for breach in expected.breaches.intervals]
    assert [breach.part for breach in analysis.breaches] == parts


def test_figures_agree_with_those_of_the_report(analysis):
    assert analysis.frames == FRAMES
    assert sum(analysis.state_seconds.values()) == pytest.approx(analysis.duration_s)
    assert sum(analysis.phase_seconds.values()) == pytest.approx(analysis.duration_s)
    assert analysis.percentiles_mm[0] == min(b.lowest_sample_mm for b in analysis.breaches)
    assert all(20.0 < breach.entry_speed_mm_s < 70.0 for breach in analysis.breaches)


def test_flat_record_is_plain_and_agrees(analysis):
    record = analysis.flat()
    assert all(value is None or isinstance(value, int | float | str) for value in record.values())
    assert record["breaches"] == 3
    assert record["deepest_mm"] == min(b.estimate.distance_mm for b in analysis.breaches)
    json.dumps(analysis.as_dict(), allow_nan=False)


def test_case_without_steps_is_refused(case):
    content = case.content
    with pytest.raises(InputError, match="expected at least 1"):
        analyse_case([], name="none", margins=content.margins, tumor=content.tumor)


def test_short_case_without_a_breach_has_unknown_figures(case):
    content = case.content
    steps = mg.replay(case, start_s=20.0, end_s=20.3)
    found = analyse_case(steps, name="short", margins=content.margins, tumor=content.tumor)
    assert (found.jitter, found.breaches) == (None, ())
    record = found.flat()
    assert record["deepest_mm"] is None
    assert record["deepest_side"] == ""
