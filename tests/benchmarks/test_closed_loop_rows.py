"""Rows of a run of many pushes that is made in parts."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.geometry import InputError
from benchmarks.closed_loop.__main__ import lines_of, merged, parsed, read_rows
from benchmarks.closed_loop.processes import drawn_registration

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


def test_parts_add_up_and_a_repeated_push_counts_once(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert read_rows(path) == []
    path.write_text(json.dumps({"rows": [row(0, 3.0), row(1, 0.5), row(0, -2.0, fixture=False)]}))
    rows = merged(read_rows(path), [row(2, 2.0), row(1, 1.5)])
    assert [(each["fixture"], each["number"]) for each in rows] == [
        (False, 0),
        (True, 0),
        (True, 1),
        (True, 2),
    ]
    assert rows[2]["lowest_mm"] == 1.5


def test_summary_counts_low_distances_and_causes_of_stops() -> None:
    rows = [row(0, 3.0), row(1, 0.5, lags=2), row(2, 2.0, lags=1, no_joints=1), row(3, 1.5)]
    printed = "\n".join(lines_of(rows, True))
    assert "4 pushes, lowest true distance 0.50 to 3.00 mm, 1 below 1 mm" in printed
    assert "2 pushes with a safe stop" in printed
    assert "by libigl at every step: 0.52 to 3.02 mm" in printed
    assert "lags 3, no_joints 1" in printed
    assert "sliding 90 to 93 mm/s" in printed  # of the pushes without a stop


@pytest.mark.parametrize("text", ["", "[]", '{"rows": [{"number": 1}]}', '{"rows": 3}'])
def test_file_of_something_else_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rows.json"
    path.write_text(text)
    with pytest.raises(InputError, match="rows of an earlier run"):
        read_rows(path)


@pytest.mark.parametrize(
    "arguments", [["--append"], ["--first-push", "-1"], ["--stops", "--append", "--json", "a.json"]]
)
def test_contradicting_options_are_refused(arguments: list[str]) -> None:
    with pytest.raises(SystemExit):
        parsed(arguments)


def test_error_of_the_base_has_the_size_that_the_landmarks_predict() -> None:
    away_mm = [
        np.linalg.norm(drawn_registration(seed).apply(TUMOR_MM) - TUMOR_MM) for seed in range(200)
    ]
    # 6 landmarks with 1 mm along each axis: at their centroid sqrt(3 / 6), a little more beside it.
    assert 0.6 < np.sqrt(np.mean(np.square(away_mm))) < 1.0
    assert max(away_mm) < 2.5
