"""The step that the page shows: of a replay, and of a live session that may stop sending."""

import threading
from dataclasses import replace

import pytest

from app.fixture import MarginState
from app.geometry import Stamp, Transform
from app.viewer import LiveFeed, ReplayFeed, ViewStateBuilder
from tests.manual_clock import ManualClock
from tests.viewer.viewed_case import BREACH_FRAME, LOST

MS = 1_000_000


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def live(parts, clock):
    return LiveFeed(ViewStateBuilder(parts.content), clock)


def steps(parts):
    return [shown.step for shown in parts.feed.shown]


def test_replay_shows_the_step_of_its_frame(parts, clock):
    feed = ReplayFeed(parts.feed.shown, clock)
    for frame in (7, 31, 7, 0):
        feed.control.step(frame - feed.control.frame)
        assert feed.now() is parts.feed.shown[frame]


def test_live_feed_is_none_before_the_first_step(live):
    assert live.now() is None


def test_live_feed_returns_the_newest_step(parts, live):
    for step in steps(parts)[:3]:
        live.put(step, parts.content, None)
    assert live.now().step is steps(parts)[2]


def test_step_with_stale_poses_is_unknown(parts, live, clock):
    stale_ns = parts.content.margins.stale_after_ns
    live.put(steps(parts)[0], parts.content, None)
    assert live.now().step.decision.state is MarginState.NEGATIVE
    clock.ns = stale_ns
    assert live.now().step.decision.state is MarginState.NEGATIVE
    clock.ns = stale_ns + 1
    late = live.now()
    assert late.step.decision.state is MarginState.UNKNOWN
    assert late.distance_mm is None
    assert late.silent == f"the session has sent nothing for more than {stale_ns // MS} ms"
    live.put(steps(parts)[1], parts.content, None)
    assert live.now().silent == ""


def test_silent_session_has_no_robot_links(parts, live, clock):
    stale_ns = parts.content.margins.stale_after_ns
    arm = {"arm": Transform.identity("base", "arm")}
    live.put(replace(steps(parts)[0], links=arm), parts.content, None)
    assert live.now().step.links == arm
    clock.ns = stale_ns + 1
    assert live.now().step.links == {}


def test_age_of_poses_at_arrival_counts(parts, live, clock):
    step = steps(parts)[0]
    stamp = Stamp(step.frame.stamp.ns - 150 * MS, step.frame.stamp.clock)
    live.put(replace(step, decision=step.decision._replace(stamp=stamp)), parts.content, None)
    clock.ns = 50 * MS
    assert live.now().step.decision.state is MarginState.NEGATIVE
    clock.ns = 50 * MS + 1
    assert live.now().step.decision.state is MarginState.UNKNOWN


def test_unknown_step_keeps_its_reason_while_the_session_steps(parts, live, clock):
    live.put(steps(parts)[0], parts.content, None)
    live.put(steps(parts)[LOST[0]], parts.content, None)
    clock.ns = 900 * MS
    assert live.now().silent == ""
    clock.ns = 1001 * MS
    assert live.now().silent


def test_ended_session_is_unknown_at_once(parts, live):
    live.put(steps(parts)[0], parts.content, None)
    live.end("the session has failed: no more tracker")
    assert live.now().step.decision.state is MarginState.UNKNOWN
    assert "no more tracker" in live.now().silent


def test_breach_in_a_skipped_step_is_counted(parts, live):
    counts = []
    for step in steps(parts):
        live.put(step, parts.content, None)
        counts.append(live.now().breaches)
    assert (counts[BREACH_FRAME - 5], counts[-1]) == (0, 1)
    assert sorted(counts) == counts


def test_callback_runs_in_the_thread_of_the_session(parts, live):
    callers = []
    live.call_on_change(lambda: callers.append(threading.current_thread().name))
    thread = threading.Thread(
        target=lambda: live.put(steps(parts)[0], parts.content, None), name="the session's"
    )
    thread.start()
    thread.join()
    assert callers == ["the session's"]
