"""A clock that is set back a little is followed; a way that becomes longer never passes for one."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS
from app.session.live_frames import SET_BACK
from app.session.set_back import MOST_REMEMBERED, STEADY_NS, SetBack
from tests.doubles import sample
from tests.session.test_live import HOST_MS, STALE_MS, World, cautery, needle

STEADY_MS = STEADY_NS // NS_PER_MS
WAY_MS = 3.0


def bring(world, sent_ms, way_ms=WAY_MS, *, stamp_error_ms=0):
    stamp_ms = sent_ms + stamp_error_ms
    for frame, at_mm in (("needle", (0.0, 0.0)), ("cautery", (30.0, 0.0))):
        place_mm = (*at_mm, 0.001 * sent_ms)  # by the moment, whatever the clock says
        world.arrive(sent_ms + way_ms, sample("tracker", frame, place_mm, stamp_ms))


def known(steps, from_ms):
    unknown = MarginState.UNKNOWN
    return [(at, step) for at, step in steps if at > from_ms and step.decision.state is not unknown]


@pytest.mark.parametrize("back_ms", [230, 300, 450])
def test_a_clock_that_was_set_back_can_be_rearmed_after_it_was_steady(back_ms):
    world = World()
    for at_ms in range(0, 8000, 20):
        bring(world, at_ms, stamp_error_ms=0 if at_ms < 1000 else -back_ms)
    world.at(7000, world.rearm)
    steps = world.run(7900)
    jumped = [at for at, step in steps if Reason.CLOCK_JUMPED_BACK in step.decision.reasons]
    assert jumped == [pytest.approx(1000 + STEADY_MS + WAY_MS, abs=25.0)]
    assert known(steps, 1000 + STALE_MS)[0][0] > jumped[0]
    held = [step.decision.hold for at, step in steps if 1200 < at < 7000]
    assert all(held)
    at, last = steps[-1]
    assert last.decision.state is MarginState.NEGATIVE
    assert not last.decision.hold
    age_ms = last.frame.stamp.ns / NS_PER_MS - (at - back_ms)
    assert age_ms == pytest.approx(-WAY_MS, abs=1.0)  # the present is that of the clock as it is
    assert world.live.left_out()[SET_BACK] == 1


def test_a_clock_that_is_set_back_by_less_than_stale_is_no_fault():
    world = World()
    for at_ms in range(0, 8000, 20):
        bring(world, at_ms, stamp_error_ms=0 if at_ms < 1000 else -100)
    steps = world.run(7900)
    assert SET_BACK not in world.live.left_out()
    assert steps[-1][1].decision.state is MarginState.NEGATIVE


def test_stamps_of_the_host_are_never_taken_for_a_clock_that_was_set_back():
    world = World(stamps_of_host=True)
    for at_ms in range(0, 8000, 20):
        bring(world, at_ms, stamp_error_ms=HOST_MS - (0 if at_ms < 1000 else 310))
    steps = world.run(7900)
    assert known(steps, 0)
    assert not known(steps, 1000 + STALE_MS)
    assert SET_BACK not in world.live.left_out()


LATER_MS = 300


def a_longer_way(world, at_ms):
    bring(world, at_ms, WAY_MS if at_ms < 1000 else WAY_MS + LATER_MS)


def a_relay_that_is_left(world, at_ms):
    """Everything comes a second time; from some moment on only so."""
    if at_ms < 1000:
        bring(world, at_ms)
    bring(world, at_ms, WAY_MS + LATER_MS)


def a_relay_of_what_was_lost(world, at_ms):
    if at_ms < 1000 and at_ms % 100:
        bring(world, at_ms)
    bring(world, at_ms, WAY_MS + LATER_MS)


def two_ways_in_turns(world, at_ms):
    is_slow = at_ms >= 1000 or at_ms % 40
    bring(world, at_ms, WAY_MS + LATER_MS if is_slow else WAY_MS)


def one_stamp_of_the_future_and_a_longer_way(world, at_ms):
    if at_ms == 980:
        bring(world, at_ms, stamp_error_ms=10_000)
    else:
        a_longer_way(world, at_ms)


def stamps_that_jitter_and_a_longer_way(world, at_ms):
    way_ms = WAY_MS if at_ms < 1000 else WAY_MS + LATER_MS
    bring(world, at_ms, way_ms, stamp_error_ms=-15)
    bring(world, at_ms + 10, way_ms)


def all_that_was_is_said_again(world, at_ms):
    """An attacker that repeats, in its rhythm and for ever, the last moments of a source."""
    if at_ms < 1000:
        bring(world, at_ms)
    else:
        again_ms = 1000 - LATER_MS + at_ms % LATER_MS
        world.arrive(at_ms, needle(again_ms), cautery(again_ms))


@pytest.mark.parametrize(
    "network",
    [
        a_longer_way,
        one_stamp_of_the_future_and_a_longer_way,
        stamps_that_jitter_and_a_longer_way,
        a_relay_that_is_left,
        a_relay_of_what_was_lost,
        two_ways_in_turns,
        all_that_was_is_said_again,
    ],
)
def test_what_is_old_is_unknown_however_long_it_is_steady(network):
    world = World()
    for at_ms in range(0, 16_000, 20):
        network(world, at_ms)
    steps = world.run(15_900)
    assert known(steps, 0)
    assert not known(steps, 1000 + STALE_MS + WAY_MS)
    assert SET_BACK not in world.live.left_out()


@settings(max_examples=15, deadline=None)
@example([(6000, 300)], 0)
@given(
    st.lists(st.tuples(st.integers(20, 7000), st.integers(3, 480)), min_size=1, max_size=4),
    st.sampled_from([0, 250, 400]),
)
def test_a_way_that_keeps_the_order_never_makes_old_poses_known(ways, relay_ms):
    """Each part of the time has its way (ms); what is sent later is never there earlier."""
    world, sent_ms, there_ms = World(), 0, 0.0
    for lasts_ms, way_ms in [(400, WAY_MS), *ways]:
        end_ms = sent_ms + lasts_ms
        while sent_ms < end_ms:
            there_ms = max(there_ms, sent_ms + way_ms)
            bring(world, sent_ms, there_ms - sent_ms)
            if relay_ms:
                bring(world, sent_ms, there_ms - sent_ms + relay_ms)
            sent_ms += 20
    for at, step in known(world.run(sent_ms + 1000), 0):
        age_ms = at - step.decision.stamp.ns / NS_PER_MS  # by a clock that is right all along
        assert age_ms <= STALE_MS + WAY_MS + 0.0002 * at + 1.0


def test_ever_more_stamps_of_the_future_are_not_kept():
    set_back = SetBack(STALE_MS * NS_PER_MS)
    for index in range(MOST_REMEMBERED + 500):
        late = sample("tracker", "needle", (0.0, 0.0, 1.0), 10_000_000 + index)
        set_back.saw(late, index, delay_ns=-10_000_000 * NS_PER_MS)
    (remembered,) = set_back._edges.values()
    assert len(remembered._samples) == MOST_REMEMBERED
