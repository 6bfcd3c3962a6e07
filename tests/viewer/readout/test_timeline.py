"""The last 30 s of a live session: when its plot is drawn, and when it has stopped."""

from dataclasses import replace

import pytest

from app.case import TrackingFrame
from app.geometry import Stamp
from app.viewer import LiveTimeline
from tests.viewer.viewed_case import BREACH_FRAME, LOST

MS = 1_000_000
S = 1000 * MS


def step_at(shown, ns):
    """The same step at another time."""
    frame = shown.step.frame
    later = TrackingFrame(Stamp(ns, frame.stamp.clock), (), ())
    return replace(shown, step=replace(shown.step, frame=later))


@pytest.fixture
def shown(parts):
    return parts.feed.shown[0]


def test_step_stays_at_its_time_for_half_a_minute(parts, shown):
    timeline = LiveTimeline()
    for n in range(401):  # 40 s
        step = parts.feed.shown[BREACH_FRAME] if n == 300 else shown
        timeline.values(step_at(step, n * 100 * MS))
    plot = timeline.new_plot()["plot"]
    red = [band for band in plot["bands"] if band["state"] == "POSITIVE"]
    assert [round(band["x"]) for band in red] == [round(1000 * 20 / 30)]
    assert plot["bands"][0]["x"] == 0.0
    last = plot["bands"][-1]
    assert last["x"] + last["w"] == pytest.approx(1000.0)


def test_plot_is_drawn_five_times_a_second(shown):
    timeline = LiveTimeline()
    drawn = []
    for n in range(21):
        timeline.values(step_at(shown, S + n * 50 * MS))
        drawn.append(bool(timeline.new_plot()))
    assert drawn == [n % 4 == 0 for n in range(21)]


def test_clock_that_jumps_back_clears_the_timeline(shown, parts):
    timeline = LiveTimeline()
    timeline.values(step_at(parts.feed.shown[BREACH_FRAME], 100 * S))
    timeline.values(step_at(shown, 7 * S))
    assert [band["state"] for band in timeline.new_plot()["plot"]["bands"]] == ["NEGATIVE"]


def test_silent_session_has_stopped_and_unknown_one_has_not(parts, shown):
    timeline = LiveTimeline()
    assert not timeline.values(None)["stopped"]
    assert not timeline.values(shown)["stopped"]
    assert not timeline.values(parts.feed.shown[LOST[0]])["stopped"]
    assert timeline.values(shown.as_unknown("the session has ended"))["stopped"]
