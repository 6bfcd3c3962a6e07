"""Figures and goals of the pushes of a run."""

import numpy as np
import pytest

from benchmarks.closed_loop.__main__ import goals_of, summary
from benchmarks.closed_loop.processes import drawn_registration
from benchmarks.harness.goals import missed

pytestmark = pytest.mark.slow

TUMOR_MM = np.array([205.0, 0.0, 80.0])


def row(number: int, lowest_mm: float, *, fixture: bool = True, **stops: int) -> dict[str, object]:
    speeds = {"approach_mm_s": 99.0, "slide_mm_s": 90.0 + number, "retreat_mm_s": 98.0}
    breach = lowest_mm if lowest_mm < 1.0 else None
    return {
        "number": number,
        "fixture": fixture,
        "lowest_mm": lowest_mm,
        "vertices_mm": lowest_mm + 0.02,
        "breach_mm": breach,
        "stops": stops,
        **speeds,
    }


def test_summary_counts_low_distances_and_causes_of_stops():
    rows = [row(0, 3.0), row(1, 0.5, lags=2), row(2, 2.0, lags=1, no_joints=1), row(3, 1.5)]
    found = summary(rows)
    assert (found["pushes"], found["below_stop"], found["interrupted"]) == (4, 1, 2)
    assert (found["lowest_mm"], found["vertices_mm"]) == ("0.50 to 3.00", "0.52 to 3.02")
    assert found["stops"] == {"lags": 3, "no_joints": 1}
    assert found["slide_mm_s"] == "90.00 to 93.00"  # of the pushes without a stop


def test_fixture_must_keep_the_margin_and_pushes_without_it_must_breach():
    assert missed(goals_of([row(0, 1.2)], "with", 1)) == []
    low = [row(0, 1.2), row(1, 0.5)]
    assert len(missed(goals_of(low, "with", 2))) == 1
    assert missed(goals_of(low, "with", 2, base_error=True)) == []
    assert len(missed(goals_of(low, "without", 2))) == 1
    assert missed(goals_of([row(0, 1.2, lags=1), row(1, 0.5)], "without", 2)) == []
    assert len(missed(goals_of([], "with", 1))) == 1


def test_error_of_the_base_has_the_size_that_the_landmarks_predict():
    away_mm = [
        np.linalg.norm(drawn_registration(seed).apply(TUMOR_MM) - TUMOR_MM) for seed in range(200)
    ]
    # 6 landmarks with 1 mm along each axis: at their centroid sqrt(3 / 6), a little more beside it.
    assert 0.6 < np.sqrt(np.mean(np.square(away_mm))) < 1.0
    assert max(away_mm) < 2.5
