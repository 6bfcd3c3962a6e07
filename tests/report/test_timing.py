import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.report.timing import StepTiming


def test_durations_become_microseconds():
    timing = StepTiming.from_durations([1_000, 2_000, 3_000])
    assert timing == StepTiming(2.0, pytest.approx(2.98), 3.0)


def test_no_steps_have_no_timing():
    assert StepTiming.from_durations([]) is None


@given(st.lists(st.integers(0, 10**9), min_size=1))
def test_percentiles_are_ordered_and_p50_is_the_median(durations):
    timing = StepTiming.from_durations(durations)
    assert timing.p50_us == pytest.approx(statistics.median(durations) / 1e3)
    assert timing.p50_us <= timing.p99_us <= timing.max_us == max(durations) / 1e3
