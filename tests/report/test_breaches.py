from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis import Breach, find_breaches
from app.fixture import MarginState
from app.report import ReportRow

STALE_NS = 200_000_000


def test_breach_runs_from_the_first_to_the_last_inside_frame(rows_of):
    breaches = find_breaches(rows_of([4.0, -1.0, -3.5, -2.0, 1.0, -0.5, 6.0]), STALE_NS)
    assert breaches == (
        Breach(pytest.approx(0.02), pytest.approx(0.06), -3.5, 2, 3, 1, 3),
        Breach(pytest.approx(0.10), pytest.approx(0.10), -0.5, 5, 1, 5, 5),
    )
    assert breaches[0].duration_s == pytest.approx(0.04)
    assert breaches[1].duration_s == 0.0


@pytest.mark.parametrize(
    ("distances", "expected"),
    [
        ([1.0, 0.0, 1.0], []),  # touches the surface
        ([-1.0, 2.0, -1.0], [(0.0, 0.0, 1), (0.04, 0.04, 1)]),  # at both ends of the recording
        ([-1.0, None, None, -2.0, None], [(0.0, 0.06, 2)]),
        ([-1.0, None, 1.0, None, -1.0], [(0.0, 0.0, 1), (0.08, 0.08, 1)]),
        # n lost frames of 20 ms leave (n + 1) 20 ms between the inside ones: 200 ms, then 220 ms.
        ([-1.0, *[None] * 9, -1.0], [(0.0, 0.2, 2)]),
        ([-1.0, *[None] * 10, -1.0], [(0.0, 0.0, 1), (0.22, 0.22, 1)]),
    ],
)
def test_dropout_up_to_stale_after_neither_ends_nor_lengthens(rows_of, distances, expected):
    breaches = find_breaches(rows_of(distances), STALE_NS)
    assert [(b.start_s, b.end_s, b.frames) for b in breaches] == [
        pytest.approx(each) for each in expected
    ]


def test_clock_that_jumps_back_splits():
    rows = [ReportRow(ns, MarginState.POSITIVE, (), -1.0) for ns in (100, 200, 50, 60)]
    assert len(find_breaches(rows, STALE_NS)) == 2


def test_breaches_do_not_depend_on_the_state():
    rows = [
        ReportRow(0, MarginState.UNKNOWN, ("starting",), -1.0),
        ReportRow(1, MarginState.POSITIVE, ("releasing",), 2.0),
    ]
    (breach,) = find_breaches(rows, STALE_NS)
    assert (breach.frames, breach.deepest) == (1, 0)


@given(st.lists(st.sampled_from([-2.0, -1.0, 0.0, 3.0, None]), max_size=60))
def test_every_inside_frame_is_in_one_breach(distances):
    rows = [
        ReportRow(index * 20_000_000, MarginState.UNKNOWN, (), distance)
        for index, distance in enumerate(distances)
    ]
    breaches = find_breaches(rows, STALE_NS)
    assert sum(b.frames for b in breaches) == sum(d is not None and d < 0 for d in distances)
    for before, after in pairwise(breaches):
        assert before.end_s < after.start_s
    for breach in breaches:
        inside = [
            row.signed_distance_mm
            for row in rows
            if breach.start_s <= row.stamp_ns / 1e9 <= breach.end_s
            and row.signed_distance_mm is not None
        ]
        assert max(inside) < 0.0
        assert min(inside) == breach.min_signed_distance_mm
        assert rows[breach.deepest].signed_distance_mm == breach.min_signed_distance_mm
