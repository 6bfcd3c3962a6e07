"""First lines of a report: breaches, the other sides, unknown time."""

from types import SimpleNamespace
from typing import Any

import pytest

from app.analysis.case_breaches import AnalysedBreach, DepthEstimate
from app.analysis.coverage import SideResult
from app.fixture import MarginState
from app.report import summarise
from app.report.answer import answer


def breach(start_s, estimate, lowest_mm=-3.0):
    place = ("posterior", "posterior", (0.0, 0.0, 0.0), "tip")
    return AnalysedBreach(start_s, start_s + 0.5, 9, lowest_mm, estimate, None, *place)


def side(name, nearest_mm, breaches=0, share: float | None = 0.0):
    return SideResult(name, 9.0, nearest_mm, {"10": share}, breaches, None)


def analysis_of(breaches, sides) -> Any:
    return SimpleNamespace(breaches=breaches, sides=sides)


def test_breaches_have_depth_interval_place_and_time_the_deepest_first(record_of):
    shallow = breach(1.0, DepthEstimate(-1.04, -1.3, 0.2, 0.9, 9))
    deep = breach(7.26, DepthEstimate(-4.87, -4.99, -4.77, 1.0, 9))
    sides = [
        side("right", 1.53),
        side("left", None),
        side("posterior", 0.0, 2),
        side("superior", None, share=None),
    ]
    found = answer(summarise(record_of([6.0, -1.0])), analysis_of([shallow, deep], sides))
    assert found.state is MarginState.POSITIVE
    assert found.headline == "2 breaches of the tumour, deepest 4.9 mm"
    assert found.lines == (
        "Breach 2: 4.9 mm deep (95 %: 4.8 to 5.0 mm), posterior, tip, at 7.3 s for 0.5 s",
        "Breach 1: 1.0 mm deep (95 %: 0.0 to 1.3 mm), posterior, tip, at 1.0 s for 0.5 s",
        "At the other sides the tool came as near as: right 1.5 mm, left more than 10 mm, "
        "superior not known.",
    )


def test_breach_without_an_estimate_has_the_measured_depth(record_of):
    found = answer(summarise(record_of([6.0, -1.0])), analysis_of([breach(1.0, None)], []))
    assert found.lines[0].startswith("Breach 1: 3.0 mm deep as measured, posterior, tip, at 1.0 s")
    plain = answer(summarise(record_of([6.0, -1.0, -2.5, 6.0])))
    assert plain.lines == ("Breach 1: 2.5 mm deep as measured, at 0.0 s for 0.0 s",)


@pytest.mark.parametrize(
    ("distances", "state", "headline"),
    [
        ([6.0, 4.2], "NEGATIVE", "The tool was never in the tumour: nearest 4.2 mm"),
        ([6.0, None, 4.2], "UNKNOWN", "No breach was measured: nearest 4.2 mm"),
        ([None, None], "UNKNOWN", "No distance is known"),
    ],
)
def test_unknown_time_is_never_a_clear_answer(record_of, distances, state, headline):
    found = answer(summarise(record_of(distances)))
    assert (found.state.name, found.headline) == (state, headline)
    assert any("not excluded" in line for line in found.lines) == (None in distances)


def test_many_breaches_are_counted_and_the_deepest_listed(record_of):
    found = answer(summarise(record_of([6.0, -1.0] * 7)))
    assert found.headline.startswith("7 breaches")
    assert len(found.lines) == 6
    assert found.lines[-1] == "and 2 less deep, in the table below"


def structure(lowest_mm, *, breaches=0, unknown=0):
    return {
        "name": "chest_wall",
        "min_signed_distance_mm": lowest_mm,
        "path_min_signed_distance_mm": None,
        "breaches": [{}] * breaches,
        "state_seconds": {"UNKNOWN": 0.5 * unknown},
        "state_counts": {"UNKNOWN": unknown},
    }


@pytest.mark.parametrize(
    ("found", "state", "headline", "line"),
    [
        (
            structure(-3.1, breaches=2),
            "POSITIVE",
            "The tool was in chest wall, never in the tumour",
            "chest wall: 2 breaches, deepest 3.1 mm",
        ),
        (
            structure(2.0, unknown=3),
            "UNKNOWN",
            "No breach was measured: nearest 4.2 mm",
            "chest wall: not entered, nearest 2.0 mm",
        ),
        (
            structure(2.0),
            "NEGATIVE",
            "The tool was never in the tumour: nearest 4.2 mm",
            "chest wall: not entered, nearest 2.0 mm",
        ),
    ],
)
def test_no_answer_is_better_than_that_of_the_worst_structure(
    record_of, found, state, headline, line
):
    given = answer(summarise(record_of([6.0, 4.2])) | {"structures": [found]})
    assert (given.state.name, given.headline) == (state, headline)
    assert line in given.lines
