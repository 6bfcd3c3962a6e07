"""Duplicated and delayed samples never make an old pose look new."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.fixture import MarginState, Reason
from app.session.live_frames import SET_BACK
from app.session.live_queues import MAX_REMEMBERED, REMEMBERED_NS, RecentSamples
from tests.doubles import sample
from tests.session.test_live import HOST_MS, STALE_MS, SimulatedHost

pytestmark = pytest.mark.slow

LATENCY_MS = 3.0
LATER_MS = 300
FOUND_MS = 40
"""By then the path from tumour to tool is known; earlier samples are not remembered."""


def bring(host, sent_ms, latency_ms=LATENCY_MS, *, stamp_error_ms=0.0):
    """Both poses of one time in ms, which the position of the tool over the tumour encodes."""
    stamp_ms = sent_ms + stamp_error_ms
    host.arrive(
        sent_ms + latency_ms,
        sample("tracker", "needle", (0.0, 0.0, 0.001 * sent_ms), stamp_ms),
        sample("tracker", "cautery", (30.0, 0.0, 0.002 * sent_ms), stamp_ms),
    )


def known(steps):
    """Times of the steps with a known margin, and the true ages of their poses (ms)."""
    unknown = MarginState.UNKNOWN
    found = [(at, step) for at, step in steps if step.decision.state is not unknown]
    return [(at, at - 1000.0 * step.tumor_from_tip.translation_mm[2]) for at, step in found]


def longer_latency(host, at_ms):
    bring(host, at_ms, LATENCY_MS if at_ms < 1000 else LATENCY_MS + LATER_MS)


def clock_set_back_a_little(host, at_ms):
    bring(host, at_ms, stamp_error_ms=0 if at_ms < 1000 else -LATER_MS)


def clock_set_back_a_little_and_longer_latency(host, at_ms):
    latency_ms = LATENCY_MS + 1000 if at_ms >= 3000 else LATENCY_MS
    bring(host, at_ms, latency_ms, stamp_error_ms=0 if at_ms < 1000 else -LATER_MS)


def queue_that_fills_while_a_pose_is_overtaken(host, at_ms):
    if at_ms == 1000:
        bring(host, at_ms, 330)
    else:
        bring(host, at_ms, LATENCY_MS if at_ms < 1200 else 320)


def relay_that_remains(host, at_ms):
    """All samples arrive twice at first, later only by the relay."""
    if at_ms < 1000:
        bring(host, at_ms)
    bring(host, at_ms, LATENCY_MS + LATER_MS)


def slow_relay_that_remains(host, at_ms):
    if at_ms < 1000:
        bring(host, at_ms)
    if at_ms >= FOUND_MS:
        bring(host, at_ms, 900)


def relay_of_samples_lost_before(host, at_ms):
    if at_ms < 1000 and not 820 <= at_ms < 880:
        bring(host, at_ms)
    bring(host, at_ms, LATENCY_MS + LATER_MS)


def standby_source_with_own_samples(host, at_ms):
    if at_ms < 1000:
        bring(host, at_ms)
    if at_ms >= 700:
        bring(host, at_ms + 7, LATENCY_MS + LATER_MS)


def one_future_stamp_and_longer_latency(host, at_ms):
    if at_ms == 980:
        bring(host, at_ms, stamp_error_ms=10_000)
    else:
        longer_latency(host, at_ms)


def past_samples_replayed_for_ever(host, at_ms):
    """An attacker repeats the last second of a source for ever, at its rate."""
    if at_ms < 1000:
        bring(host, at_ms)
    else:
        again_ms = FOUND_MS + at_ms % (1000 - FOUND_MS)
        bring(host, again_ms, at_ms - again_ms)


@pytest.mark.parametrize(
    "source",
    [
        longer_latency,
        clock_set_back_a_little,
        clock_set_back_a_little_and_longer_latency,
        queue_that_fills_while_a_pose_is_overtaken,
        relay_that_remains,
        slow_relay_that_remains,
        relay_of_samples_lost_before,
        standby_source_with_own_samples,
        one_future_stamp_and_longer_latency,
        past_samples_replayed_for_ever,
    ],
)
def test_late_source_is_unknown_however_steady(source):
    host = SimulatedHost()
    for at_ms in range(0, 6_000, 20):
        source(host, at_ms)
    found = known(host.run(5_900))
    assert 900 < found[-1][0] < 1300 + STALE_MS
    assert max(age_ms for _, age_ms in found) <= STALE_MS + LATENCY_MS + 20
    assert SET_BACK not in host.live.left_out()


@pytest.mark.parametrize("stamps_of_host", [False, True])
def test_slow_repetition_is_no_fault(stamps_of_host):
    host = SimulatedHost(stamps_of_host)
    for at_ms in range(0, 3000, 20):
        bring(host, at_ms, stamp_error_ms=HOST_MS if stamps_of_host else 0)
        if at_ms >= FOUND_MS:
            bring(host, at_ms, 900, stamp_error_ms=HOST_MS if stamps_of_host else 0)
    steps = host.run(2900)
    assert not any(step.decision.hold for at, step in steps if at > 200)
    assert SET_BACK not in host.live.left_out()


def test_clock_set_back_by_more_than_half_a_second_is_counted_and_followed():
    host = SimulatedHost()
    for at_ms in range(0, 3000, 20):
        bring(host, at_ms, stamp_error_ms=0 if at_ms < 1000 else -610)
    steps = host.run(2900)
    jumped = [at for at, step in steps if Reason.CLOCK_JUMPED_BACK in step.decision.reasons]
    assert jumped == [pytest.approx(1000 + LATENCY_MS, abs=1.0)]
    assert host.live.left_out()[SET_BACK] == 1
    assert known(steps)[-1][0] > 2800
    assert steps[-1][1].decision.hold


@settings(max_examples=3)
@example([(6000, 300)], 0)
@example([(6000, 3)], 900)
@given(
    st.lists(st.tuples(st.integers(20, 7000), st.integers(3, 4000)), min_size=1, max_size=4),
    st.sampled_from([0, 250, 400, 900, 3000]),
)
def test_delay_that_keeps_order_never_makes_old_poses_known(latencies, relay_ms):
    """Each interval has its latency (ms); the order of arrival is the order of sending."""
    host, sent_ms, there_ms = SimulatedHost(), 0, 0.0
    for lasts_ms, latency_ms in [(400, LATENCY_MS), *latencies]:
        end_ms = sent_ms + lasts_ms
        while sent_ms < end_ms:
            there_ms = max(there_ms, sent_ms + latency_ms)
            bring(host, sent_ms, there_ms - sent_ms)
            if relay_ms and sent_ms >= FOUND_MS:
                bring(host, sent_ms, there_ms - sent_ms + relay_ms)
            sent_ms += 20
    for at, age_ms in known(host.run(sent_ms + 5000)):
        assert age_ms <= STALE_MS + LATENCY_MS + 0.0002 * at + 20.0


def moment(at_ms, place_mm=1.0):
    return sample("tracker", "needle", (0.0, 0.0, place_mm), at_ms)


def test_only_identical_samples_are_duplicates():
    recent = RecentSamples()
    assert not recent.is_duplicate(moment(100), 0)
    assert recent.is_duplicate(moment(100), 1)
    assert not recent.is_duplicate(moment(120), 2)
    assert not recent.is_duplicate(moment(100, 1.0 + 1e-12), 3)
    assert not recent.is_duplicate(sample("tracker", "cautery", (0.0, 0.0, 1.0), 100), 4)


def test_sample_expires_unless_it_is_repeated():
    recent = RecentSamples()
    recent.is_duplicate(moment(100), 0)
    assert recent.is_duplicate(moment(100), REMEMBERED_NS)
    assert recent.is_duplicate(moment(100), 2 * REMEMBERED_NS)
    assert not recent.is_duplicate(moment(100), 3 * REMEMBERED_NS + 1)


def test_number_of_remembered_samples_is_bounded():
    recent = RecentSamples()
    for index in range(MAX_REMEMBERED + 500):
        recent.is_duplicate(moment(index), 0)
    assert not recent.is_duplicate(moment(499), 0)
    assert recent.is_duplicate(moment(MAX_REMEMBERED + 499), 0)
    (remembered,) = recent._edges.values()
    assert len(remembered) == MAX_REMEMBERED
