import json
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import Expected
from app.fixture import MarginState
from app.geometry import Transform
from app.registration import given_registration, register_points
from app.report import ReportRow, all_passed, summarise
from app.report.rows import ReasonCount, count_reasons
from app.report.summary import duration_ns, state_durations_ns, step_timing


def test_summary_of_hand_computed_rows(record_of):
    summary = summarise(
        record_of([8.0, 3.0, -1.0, -2.5, None, 7.0], durations_ns=(1000, 2000, 3000, 1000, 1, 1))
    )
    assert summary["case"] == "three frames"
    assert (summary["frames"], summary["valid_frames"], summary["inside_frames"]) == (6, 5, 2)
    assert summary["duration_s"] == 0.1
    assert summary["state_counts"] == {"NEGATIVE": 2, "WARNING": 1, "POSITIVE": 2, "UNKNOWN": 1}
    assert summary["state_seconds"] == {
        "NEGATIVE": 0.02,  # the first frame; the last one adds 0
        "WARNING": 0.02,
        "POSITIVE": 0.04,
        "UNKNOWN": 0.02,
    }
    assert summary["min_signed_distance_mm"] == -2.5
    assert summary["breaches"] == [
        {
            "start_s": 0.04,
            "end_s": 0.06,
            "duration_s": 0.02,
            "min_signed_distance_mm": -2.5,
            "between_frames": False,
            "deepest_s": None,
            "path_min_signed_distance_mm": None,
            "path_lower_bound_mm": None,
        }
    ]
    assert summary["margins"]["stale_after_ms"] == 200.0
    assert summary["timing"] == {"step_p50_us": 1.0, "step_p99_us": 3.0, "step_max_us": 3.0}
    assert summary["expected"] is None
    assert summary["registration"] is None
    assert all_passed(summary)


def test_summary_has_json_types_only(record_of):
    pose = Transform("reference", "robot_base", np.eye(3), np.array([1.0, 2.0, 3.0]))
    record = record_of([None, None], registration=given_registration(pose), expected=Expected())
    summary = summarise(record)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["min_signed_distance_mm"] is None
    assert summary["registration"]["method"] == "given"
    assert summary["registration"]["fre_mm"] is None
    assert summary["registration"]["matrix"] == [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]
    assert summary["expected"] == []


def test_computed_registration(record_of):
    moving = np.array([[0.0, 0, 0], [50, 0, 0], [0, 60, 0], [0, 0, 40]])
    fixed = (
        moving + [10.0, 20.0, 30.0] + 0.1 * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0] * 3])
    )
    result = register_points(fixed, moving, fixed_frame="reference", moving_frame="robot_base")
    values = summarise(record_of([1.0], registration=result))["registration"]
    assert values["points"] == 4
    assert values["fre_mm"] == pytest.approx(result.fre_mm, abs=1e-6)
    assert values["residuals_mm"] == pytest.approx(result.residuals_mm.tolist(), abs=1e-6)


def test_failed_expectation_is_reported(record_of):
    summary = summarise(record_of([1.0, 1.0], expected=Expected(frames=3)))
    assert summary["expected"] == [
        {"check": "frames", "result": "fail", "detail": "2 frames, 3 expected"}
    ]
    assert not all_passed(summary)


@given(
    st.integers(-(10**15), 10**18),
    st.lists(st.tuples(st.sampled_from(MarginState), st.integers(0, 10**10)), min_size=1),
)
def test_state_seconds_sum_to_the_duration(first_ns, steps):
    rows, now = [], first_ns
    for state, period_ns in steps:
        rows.append(ReportRow(now, state))
        now += period_ns
    assert sum(state_durations_ns(rows).values()) == duration_ns(rows)
    assert duration_ns(rows) == rows[-1].stamp_ns - rows[0].stamp_ns


def test_clock_that_jumps_back_adds_no_time():
    rows = [ReportRow(ns, MarginState.UNKNOWN) for ns in (0, 100, 40, 70)]
    assert duration_ns(rows) == 130
    assert sum(state_durations_ns(rows).values()) == 130


def test_reasons_are_counted_most_frequent_first(rows_of):
    assert count_reasons(rows_of([6.0, None, None, None, 3.0, 6.0])) == (
        ReasonCount("invalid", 3, pytest.approx(0.02)),
        ReasonCount("stale", 3, pytest.approx(0.02)),
        ReasonCount("clear", 2, 0.0),
        ReasonCount("warning_distance", 1, pytest.approx(0.08)),
    )


def test_nothing_has_no_reasons_and_no_timing():
    assert count_reasons([]) == ()
    assert set(step_timing([]).values()) == {None}


@given(st.lists(st.integers(0, 10**9), min_size=1))
def test_percentiles_are_ordered_and_p50_is_the_median(durations):
    p50_us, p99_us, max_us = step_timing(durations).values()
    assert p50_us == pytest.approx(statistics.median(durations) / 1e3, abs=0.06)
    assert p50_us <= p99_us <= max_us == round(max(durations) / 1e3, 1)
