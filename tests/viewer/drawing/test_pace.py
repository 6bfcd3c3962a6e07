"""The pace of the pictures: below 0.7 of what drawing allows, 2 to 30 a second."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.viewer.drawing.frame_rate import Pace

MS = 1_000_000


@given(st.lists(st.integers(0, 2_000 * MS), min_size=1))
def test_drawing_takes_at_most_seven_tenths_of_the_time(costs):
    pace = Pace()
    for cost in costs:
        pace.drew(cost)
        assert 500 * MS >= pace.period_ns >= 33 * MS
        assert pace.period_ns == 500 * MS or cost <= 0.7 * pace.period_ns + 1


def test_slow_picture_counts_at_once_and_fast_ones_gradually():
    pace = Pace()
    pace.drew(210 * MS)
    assert pace.period_ns == pytest.approx(300 * MS)
    pace.drew(21 * MS)
    assert 200 * MS < pace.period_ns < 300 * MS
    for _ in range(40):
        pace.drew(35 * MS)
    assert pace.period_ns == pytest.approx(50 * MS, rel=0.01)
