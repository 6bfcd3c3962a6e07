"""The last half minute of a live session: what is drawn of it, and what is said when it stops."""

from dataclasses import replace

import pytest

from app.case import TrackingFrame
from app.geometry import Stamp
from app.viewer import LiveTimeline
from app.viewer.steps.view_state import ViewState
from tests.viewer.viewed_case import BREACH_FRAME, LOST

MS = 1_000_000
S = 1000 * MS


def at(shown: ViewState, ns: int) -> ViewState:
    """The same step at another time."""
    frame = shown.step.frame
    later = TrackingFrame(Stamp(ns, frame.stamp.clock), (), ())
    return replace(shown, step=replace(shown.step, frame=later))


@pytest.fixture
def shown(parts) -> ViewState:
    return parts.feed.shown[0]


def test_what_was_shown_stands_where_it_was_and_leaves_after_half_a_minute(parts, shown):
    timeline = LiveTimeline()
    for n in range(401):  # 40 s
        step = parts.feed.shown[BREACH_FRAME] if n == 300 else shown
        timeline.at(at(step, n * 100 * MS))
    plot = timeline.news()["plot"]
    red = [band for band in plot["bands"] if band["state"] == "POSITIVE"]
    assert [round(band["x"]) for band in red] == [round(1000 * 20 / 30)]
    assert plot["bands"][0]["x"] == 0.0
    last = plot["bands"][-1]
    assert last["x"] + last["w"] == pytest.approx(1000.0)


def test_it_is_drawn_five_times_a_second(shown):
    timeline = LiveTimeline()
    drawn = []
    for n in range(21):
        timeline.at(at(shown, S + n * 50 * MS))
        drawn.append(bool(timeline.news()))
    assert drawn == [n % 4 == 0 for n in range(21)]


def test_a_source_that_has_another_clock_now_begins_it_anew(shown, parts):
    timeline = LiveTimeline()
    timeline.at(at(parts.feed.shown[BREACH_FRAME], 100 * S))
    timeline.at(at(shown, 7 * S))
    assert [band["state"] for band in timeline.news()["plot"]["bands"]] == ["NEGATIVE"]


def test_a_session_that_is_silent_has_stopped_and_one_that_is_unknown_has_not(parts, shown):
    timeline = LiveTimeline()
    assert not timeline.at(None)["stopped"]
    assert not timeline.at(shown)["stopped"]
    assert not timeline.at(parts.feed.shown[LOST[0]])["stopped"]
    assert timeline.at(shown.as_unknown("the session has ended"))["stopped"]
