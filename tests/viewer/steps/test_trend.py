"""Trend of the distance."""

import numpy as np
import pytest

from app.viewer.view_state import Trend, TrendMeter

MS = 1_000_000


def trends(speeds_mm_s, *, begin_mm=20.0, step_ms=20):
    meter, distance, found = TrendMeter(), begin_mm, []
    for n, speed in enumerate(speeds_mm_s):
        distance += speed * step_ms / 1000.0
        found.append(meter.update(n * step_ms * MS, distance))
    return found


@pytest.mark.parametrize(
    ("speed", "trend"), [(-10.0, Trend.APPROACHING), (10.0, Trend.RETREATING), (0.5, Trend.STEADY)]
)
def test_constant_speed_has_trend_after_a_tenth_of_a_second(speed, trend):
    found = trends([speed] * 20)
    assert set(found[:5]) == {Trend.NONE}
    assert set(found[6:]) == {trend}


def test_noise_of_still_tool_is_steady():
    meter, noise = TrendMeter(), np.random.default_rng(1)
    found = {meter.update(n * 20 * MS, 5.0 + noise.normal(0.0, 0.05)) for n in range(500)}
    assert found == {Trend.NONE, Trend.STEADY}


def test_deeper_inside_is_still_approaching():
    assert trends([-10.0] * 20, begin_mm=-1.0)[-1] is Trend.APPROACHING


@pytest.mark.parametrize("after", [(600 * MS, 4.0), (400 * MS, None), (0, 4.0)])
def test_gap_unknown_distance_and_jump_back_reset_the_trend(after):
    meter = TrendMeter()
    for n in range(11):
        assert meter.update(n * 20 * MS, 5.0 - 0.2 * n) in (Trend.NONE, Trend.APPROACHING)
    assert meter.update(*after) is Trend.NONE
