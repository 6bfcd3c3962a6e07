"""The shapes of the plot, parsed from their SVG."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.fixture import MarginState
from app.viewer.timeline import WIDTH, Point, plot
from tests.doubles import PARAMETERS

S = 1_000_000_000
MARGINS = PARAMETERS
CLEAR, UNKNOWN, INSIDE = MarginState.NEGATIVE, MarginState.UNKNOWN, MarginState.POSITIVE


def strokes(curve):
    """The strokes of a path as arrays (n, 2)."""
    return [
        np.array([[float(v) for v in pair.split()] for pair in re.split("[ML]", part)[1:]])
        for part in re.findall(r"M[^M]+", curve)
    ]


def heights_of(drawn):
    """y of 0 mm and of 5 mm, from the lines of the scale."""
    lines = {line["label"]: line["y"] for line in drawn["lines"]}
    return lines["0"], lines["5"]


def test_curve_agrees_with_its_scale():
    points = [Point(n * S, CLEAR, mm) for n, mm in enumerate([5.0, 0.0, -1.5, 2.5])]
    drawn = plot(points, [], 0, 3 * S, MARGINS)
    zero, five = heights_of(drawn)
    (stroke,) = strokes(drawn["curve"])
    assert stroke[:, 0] == pytest.approx([0.0, WIDTH / 3, 2 * WIDTH / 3, WIDTH], abs=0.01)
    expected = [zero + (five - zero) * mm / 5.0 for mm in (5.0, 0.0, -1.5, 2.5)]
    assert stroke[:, 1] == pytest.approx(expected, abs=0.03)


def test_large_distance_leaves_the_picture():
    points = [Point(0, CLEAR, 5.0), Point(S, CLEAR, 60.0)]
    (stroke,) = strokes(plot(points, [], 0, S, MARGINS)["curve"])
    assert stroke[0, 1] > 0.0 > stroke[1, 1]


def test_curve_has_a_gap_while_the_distance_is_unknown():
    points = [Point(n * S, CLEAR, 3.0) for n in range(3)]
    points += [Point(3 * S, UNKNOWN, None)]
    points += [Point(n * S, CLEAR, 3.0) for n in range(4, 6)]
    drawn = plot(points, [], 0, 5 * S, MARGINS)
    assert [len(stroke) for stroke in strokes(drawn["curve"])] == [3, 2]
    assert [band["state"] for band in drawn["bands"]] == ["NEGATIVE", "UNKNOWN", "NEGATIVE"]


def test_bands_cover_the_time_without_a_gap():
    states = [CLEAR, CLEAR, INSIDE, INSIDE, UNKNOWN, CLEAR]
    points = [Point(n * S, state, 1.0) for n, state in enumerate(states)]
    bands = plot(points, [], 0, 5 * S, MARGINS)["bands"]
    ends = [band["x"] + band["w"] for band in bands]
    assert bands[0]["x"] == 0.0
    assert ends == pytest.approx([*(band["x"] for band in bands[1:]), WIDTH], abs=0.02)


def test_breaches_are_marked_at_their_times():
    points = [Point(n * S, CLEAR, 1.0) for n in range(11)]
    drawn = plot(points, [(2 * S, 4 * S), (9 * S, 9 * S)], 0, 10 * S, MARGINS)
    assert drawn["breaches"] == [{"x": 200.0, "w": 200.0}, {"x": 900.0, "w": 0.0}]


def test_single_unknown_frame_is_drawn():
    drawn = plot([Point(5, UNKNOWN, None)], [], 5, 5, MARGINS)
    assert drawn["curve"] == ""
    assert [band["state"] for band in drawn["bands"]] == ["UNKNOWN"]


@settings(max_examples=6)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 1.0]))
def test_plot_of_a_long_recording_keeps_its_extremes(seed, unknown_share):
    random = np.random.default_rng(seed)
    mm = random.uniform(-20.0, 25.0, 3500)
    unknown = random.random(3500) < unknown_share
    points = [
        Point(n * S, UNKNOWN if lost else CLEAR, None if lost else at)
        for n, (at, lost) in enumerate(zip(mm.tolist(), unknown.tolist(), strict=True))
    ]
    drawn = plot(points, [], 0, points[-1].time_ns, MARGINS)
    y = np.concatenate([*(stroke[:, 1] for stroke in strokes(drawn["curve"])), np.empty(0)])
    if unknown.all():
        assert not len(y)
        return
    zero, five = heights_of(drawn)
    known = mm[~unknown]
    expected = zero + (five - zero) * np.array([known.max(), known.min()]) / 5.0
    assert [y.min(), y.max()] == pytest.approx(expected, abs=0.1)
    assert len(y) <= 3 * 1500


def test_stop_and_warning_distances_have_lines_on_the_scale():
    points = [Point(0, CLEAR, 20.0), Point(S, INSIDE, -4.0)]
    drawn = plot(points, [], 0, S, MARGINS.replaced(stop_mm=2.0, warn_mm=6.0))
    assert [(each["name"], each["label"]) for each in drawn["limits"]] == [
        ("stop", "stop 2 mm"),
        ("warning", "warning 6 mm"),
    ]
    # A height on the plot is a distance: the hover uses it.
    for limit, distance in zip(drawn["limits"], (2.0, 6.0), strict=True):
        mm = drawn["top_mm"] - limit["y"] / 100.0 * drawn["mm"]
        assert mm == pytest.approx(distance, abs=0.01)
    assert drawn["seconds"] == 1.0
    outside = plot(points, [], 0, S, MARGINS.replaced(stop_mm=2.0, warn_mm=90.0))
    assert [each["name"] for each in outside["limits"]] == ["stop"]
