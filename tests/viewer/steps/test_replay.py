"""Position of a replay, compared with a slow player that advances frame by frame."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.viewer.address import ViewerError
from app.viewer.feeds import RATES, ReplayControl
from tests.manual_clock import ManualClock

MS = 1_000_000
STAMPS = [0, 20 * MS, 40 * MS, 100 * MS, 120 * MS]


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def control(clock):
    return ReplayControl(STAMPS, clock)


def test_replay_begins_paused_at_the_first_frame(control, clock):
    clock.ns = 10**12
    assert (control.frame, control.playing, control.frames) == (0, False, 5)
    assert control.duration_ns == 120 * MS


@pytest.mark.parametrize("share", [-0.001, 1.001, float("nan")])
def test_share_out_of_range_is_refused(control, share):
    with pytest.raises(ViewerError, match="expected 0 to 1"):
        control.seek(share)
    assert control.frame == 0


def test_unsupported_rate_is_refused(control):
    with pytest.raises(ViewerError, match="one of"):
        control.set_rate(3.0)


def test_recording_without_frames_is_refused(clock):
    with pytest.raises(ViewerError, match="0 frames"):
        ReplayControl([], clock)


def test_stamp_that_jumps_back_counts_as_no_time(clock):
    control = ReplayControl([100, 200, 50, 150], clock)
    assert [control.time_ns(n) for n in range(4)] == [0, 100, 100, 200]


class SlowPlayer:
    """A test double: advances recorded time in steps of one nanosecond."""

    def __init__(self, stamps):
        self.due = [0]
        for before, after in pairwise(stamps):
            self.due.append(self.due[-1] + max(after - before, 0))
        self.media, self.rate, self.playing = 0.0, 1.0, False
        self.frame = 0

    def wait(self, ns):
        if self.playing:
            self.media += ns * self.rate
            self.frame = max(n for n, at in enumerate(self.due) if at <= round(self.media))
            self.playing = self.media < self.due[-1]


ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("wait"), st.integers(0, 300)),
        st.tuples(st.just("rate"), st.sampled_from([0.5, 1.0, 2.0, 4.0])),
        st.tuples(st.just("play"), st.just(0)),
        st.tuples(st.just("pause"), st.just(0)),
        st.tuples(st.just("step"), st.integers(-3, 3)),
        st.tuples(st.just("seek"), st.integers(0, 30)),
    ),
    max_size=30,
)


@given(st.lists(st.integers(1, 100), max_size=12), ACTIONS)
def test_any_sequence_of_actions_agrees_with_the_slow_player(gaps, actions):
    stamps = [0]
    for gap in gaps:
        stamps.append(stamps[-1] + 2 * gap)  # even, so that half a rate has no half nanosecond
    clock, slow = ManualClock(), SlowPlayer(stamps)
    control = ReplayControl(stamps, clock)
    for action, value in actions:
        if action == "wait":
            clock.ns += 2 * value
            slow.wait(2 * value)
        elif action == "rate":
            control.set_rate(value)
            slow.rate = value
        elif action == "play":
            if not slow.playing:
                slow.frame = 0 if slow.frame == len(stamps) - 1 else slow.frame
                slow.media = slow.due[slow.frame]
                slow.playing = len(stamps) > 1
                control.play()
        elif action == "pause":
            control.pause()
            slow.playing = False
        elif action == "step":
            control.step(value)
            slow.frame = min(max(slow.frame + value, 0), len(stamps) - 1)
            slow.playing = False
        else:
            frame = value % len(stamps)
            control.seek(slow.due[frame] / max(slow.due[-1], 1))
            slow.frame, slow.media = frame, slow.due[frame]
            slow.playing = slow.playing and frame < len(stamps) - 1
        assert (control.frame, control.playing) == (slow.frame, slow.playing)


def test_rates_include_real_time():
    assert 1.0 in RATES
