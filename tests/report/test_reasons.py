import pytest

from app.report.reasons import ReasonCount, count_reasons


def test_most_frequent_first(rows_of):
    assert count_reasons(rows_of([6.0, None, None, None, 3.0, 6.0])) == (
        ReasonCount("invalid", 3, pytest.approx(0.02)),
        ReasonCount("stale", 3, pytest.approx(0.02)),
        ReasonCount("clear", 2, 0.0),
        ReasonCount("warning_distance", 1, pytest.approx(0.08)),
    )


def test_no_rows_no_reasons():
    assert count_reasons([]) == ()
