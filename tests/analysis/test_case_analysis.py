"""The analysis of the shipped case, whose truth is known: the frames around its breaches.

The whole case is analysed in `tests/analysis/test_whole_cases.py`.
"""

import json
from collections.abc import Iterator

import pytest

import marginguard as mg
from app.analysis import CaseAnalysis, analyse_case
from app.geometry import NS_PER_S, InputError
from app.session import Session, StepResult
from tests.shipped_case import BREACHES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def case() -> mg.PreparedCase:
    return mg.open_case(mg.example_case())


def analysed(case: mg.PreparedCase, steps: Iterator[StepResult]) -> CaseAnalysis:
    content = case.content
    return analyse_case(steps, name=content.name, margins=content.margins, tumor=content.tumor)


@pytest.fixture(scope="module")
def steps(case) -> list[StepResult]:
    """From 8 s before each breach until 2 s after it."""
    spans = [(breach["start_s"] - 8.0, breach["end_s"] + 2.0) for breach in BREACHES]
    sessions = [Session(case.setup) for _ in spans]
    found, first_ns = [], None
    for frame in case.case.frames():
        first_ns = frame.stamp.ns if first_ns is None else first_ns
        at_s = (frame.stamp.ns - first_ns) / NS_PER_S
        for session, (start_s, end_s) in zip(sessions, spans, strict=True):
            if start_s <= at_s <= end_s:
                found.append(session.step(frame))
    return found


@pytest.fixture(scope="module")
def analysis(case, steps) -> CaseAnalysis:
    return analysed(case, iter(steps))


def check_breaches(case: mg.PreparedCase, analysis: CaseAnalysis) -> None:
    """Calibration and contour have errors, which an interval of the noise does not contain."""
    expected = case.case.expected().breaches
    truths = [breach.min_signed_distance_mm for breach in expected.intervals]
    assert len(analysis.breaches) == len(truths) == 3
    for breach, truth in zip(analysis.breaches, truths, strict=True):
        assert breach.estimate is not None
        assert breach.estimate.low_mm < breach.estimate.distance_mm < breach.estimate.high_mm
        assert abs(breach.estimate.distance_mm - truth) < expected.depth_tolerance_mm
        assert breach.lowest_sample_mm < breach.estimate.distance_mm
    parts = ["shaft" if breach.shaft_only else "tip" for breach in expected.intervals]
    assert [breach.part for breach in analysis.breaches] == parts


def check_figures(analysis: CaseAnalysis, frames: int) -> None:
    assert analysis.frames == frames
    assert sum(analysis.state_seconds.values()) == pytest.approx(analysis.duration_s)
    assert sum(analysis.phase_seconds.values()) == pytest.approx(analysis.duration_s)
    assert analysis.percentiles_mm[0] == min(b.lowest_sample_mm for b in analysis.breaches)
    assert all(20.0 < breach.entry_speed_mm_s < 70.0 for breach in analysis.breaches)


def test_depths_are_within_the_tolerance_of_the_case_and_higher_than_the_lowest_samples(
    case, analysis
):
    check_breaches(case, analysis)


def test_figures_agree_with_those_of_the_report(analysis, steps):
    check_figures(analysis, len(steps))


def test_flat_record_is_plain_and_agrees(analysis):
    record = analysis.flat()
    assert all(value is None or isinstance(value, int | float | str) for value in record.values())
    assert record["breaches"] == 3
    assert record["deepest_mm"] == min(b.estimate.distance_mm for b in analysis.breaches)
    json.dumps(analysis.as_dict(), allow_nan=False)


def test_case_without_steps_is_refused(case):
    with pytest.raises(InputError, match="expected at least 1"):
        analysed(case, iter([]))


def test_short_case_without_a_breach_has_unknown_figures(case):
    found = analysed(case, mg.replay(case, start_s=20.0, end_s=20.3))
    assert (found.jitter, found.breaches) == (None, ())
    record = found.flat()
    assert record["deepest_mm"] is None
    assert record["deepest_side"] == ""
