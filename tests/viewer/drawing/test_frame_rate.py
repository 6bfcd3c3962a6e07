"""The frame rate: drawing takes at most 0.85 of the time, 2 to 30 pictures per second."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.viewer.drawing.frame_rate import FrameRate

MS = 1_000_000


@given(st.lists(st.integers(0, 2_000 * MS), min_size=1))
def test_drawing_takes_no_more_than_its_share_of_the_time(costs):
    rate = FrameRate()
    for cost in costs:
        rate.record(cost)
        assert 500 * MS >= rate.period_ns >= 33 * MS
        assert rate.period_ns == 500 * MS or cost <= 0.85 * rate.period_ns + 1


def test_slow_picture_counts_at_once_and_fast_ones_gradually():
    rate = FrameRate()
    rate.record(255 * MS)
    assert rate.period_ns == pytest.approx(300 * MS)
    rate.record(25 * MS)
    assert 200 * MS < rate.period_ns < 300 * MS
    for _ in range(40):
        rate.record(42.5 * MS)
    assert rate.period_ns == pytest.approx(50 * MS, rel=0.01)
