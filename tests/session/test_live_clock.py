"""The source's clock, and joints that wait for the tracker's present."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import NS_PER_MS, NS_PER_S, Stamp
from app.session.live_frames import (
    CONFIRMED_BY,
    CONFIRMED_WITHIN_NS,
    DRIFT,
    MAX_UNCONFIRMED,
    SourceClock,
)
from app.session.live_queues import MAX_JOINTS, JointQueue
from tests.doubles import joint_sample
from tests.oracles.source_clock import exhaustive_offsets

HOURS_NS = 3600 * NS_PER_S


def test_host_clock_needs_no_estimate():
    clock = SourceClock(stamps_of_host=True)
    clock.observe(5, 1000)
    clock.restart()
    assert clock.now(1234) == Stamp(1234)
    assert clock.host_time_for(7) == 7


def test_time_is_unknown_until_three_samples_agree():
    clock = SourceClock(stamps_of_host=False)
    assert clock.now(1000) is None
    for ns in (5, 5, 6):  # two edges with one stamp count once
        clock.observe(ns, ns + 1000)
        assert clock.now(2000) is None
    clock.observe(7, 1007)
    assert clock.now(1008) == Stamp(8)
    clock.restart()
    assert clock.now(1008) is None


@given(
    st.lists(st.tuples(st.integers(1, NS_PER_S), st.integers(0, NS_PER_S)), min_size=1),
    st.integers(-HOURS_NS, HOURS_NS),
    st.floats(-0.9 * DRIFT, 0.9 * DRIFT),
)
def test_ages_are_too_short_by_the_lowest_latency_at_most(samples, offset_ns, skew):
    """The source's clock drifts within the bound; each sample has its own latency."""

    def source_ns(at_ns):
        return round(at_ns * (1.0 + skew)) + offset_ns

    clock, host_ns, fastest_ns = SourceClock(stamps_of_host=False), 0, NS_PER_S
    for _ in range(CONFIRMED_BY):  # the first samples confirm the offset, with the longest latency
        host_ns += NS_PER_MS
        clock.observe(source_ns(host_ns - NS_PER_S), host_ns)
    for period_ns, latency_ns in samples:
        host_ns += period_ns
        stamp_ns = source_ns(host_ns - latency_ns)
        clock.observe(stamp_ns, host_ns)
        age_ns = clock.now(host_ns).ns - stamp_ns
        if age_ns < -CONFIRMED_WITHIN_NS:
            continue  # from the future: not accepted until others agree
        assert age_ns >= 0
        fastest_ns = min(fastest_ns, latency_ns)
        # The true age minus the lowest latency, which cannot be observed, and the allowed drift.
        slack_ns = 2 * DRIFT * host_ns + 10
        assert age_ns >= latency_ns * (1.0 - DRIFT) - fastest_ns - slack_ns
        assert age_ns <= latency_ns * (1.0 + DRIFT) + slack_ns


def test_growing_latency_appears_as_age_and_not_as_offset():
    clock = SourceClock(stamps_of_host=False)
    for second in range(60):
        clock.observe(second * NS_PER_S, second * NS_PER_S + 1_000_000)
    late_ns = 60 * NS_PER_S + 101_000_000
    clock.observe(60 * NS_PER_S, late_ns)
    age_ns = clock.now(late_ns).ns - 60 * NS_PER_S
    assert age_ns == pytest.approx(100_000_000, abs=2 * DRIFT * NS_PER_S)


@given(
    st.lists(
        st.tuples(
            st.integers(0, 3 * NS_PER_S),  # until it arrives
            st.sampled_from([0, 5, 15, 25, 300, 310, 340, -100, -500])
            | st.integers(-1000, 1000),  # how far ahead its stamp is, ms
        ),
        max_size=MAX_UNCONFIRMED,
    )
)
def test_estimate_equals_exhaustive_search_over_all_samples(samples):
    clock, host_ns, arrivals, found = SourceClock(stamps_of_host=False), 0, [], []
    for wait_ns, ahead_ms in samples:
        host_ns += wait_ns
        arrivals.append((host_ns + ahead_ms * NS_PER_MS, host_ns))
        clock.observe(*arrivals[-1])
        found.append(clock.offset_ns(host_ns))
    assert found == list(exhaustive_offsets(arrivals))


def tracked(clock, start_ms, end_ms, latency_ms=3.0, skew=0.0):
    """50 Hz, each sample with a latency of ``latency_ms``; the source's clock gains ``skew``."""
    for at_ms in range(start_ms, end_ms, 20):
        clock.observe(
            round(at_ms * (1.0 + skew) * NS_PER_MS), round((at_ms + latency_ms) * NS_PER_MS)
        )


@pytest.mark.parametrize("error_ms", [300, 100, -300, 10_000_000])
def test_occasional_wrong_stamp_does_not_age_other_samples(error_ms):
    clock = SourceClock(stamps_of_host=False)
    for minute in range(10):
        tracked(clock, 60_000 * minute, 60_000 * minute + 1000)
        host_ns = (60_000 * minute + 1010) * NS_PER_MS
        clock.observe(host_ns + error_ms * NS_PER_MS, host_ns)
        clock.observe(host_ns + (error_ms + 1) * NS_PER_MS, host_ns)
        age_ms = (clock.now(host_ns).ns - (host_ns - 10 * NS_PER_MS)) / NS_PER_MS
        assert age_ms == pytest.approx(10.0 - 3.0, abs=0.4 + 60.0 * 0.2)


def test_clock_set_forward_is_followed_at_its_third_sample():
    clock = SourceClock(stamps_of_host=False)
    tracked(clock, 0, 1000)
    times = []
    for index in range(4):
        host_ns = (1000 + 20 * index) * NS_PER_MS
        clock.observe(host_ns + 3_600_000 * NS_PER_MS, host_ns)
        times.append(clock.now(host_ns).ns - host_ns > 3_599_000 * NS_PER_MS)
    assert times == [False, False, True, True]


@pytest.mark.parametrize("skew", [-1e-4, 1e-4])
def test_drifting_clock_is_followed_for_hours(skew):
    clock = SourceClock(stamps_of_host=False)
    for hour in range(3):
        tracked(clock, 3_600_000 * hour, 3_600_000 * hour + 60_000, skew=skew)
        at_ms = 3_600_000 * hour + 60_000
        age_ms = clock.now(at_ms * NS_PER_MS).ns / NS_PER_MS - at_ms * (1.0 + skew)
        assert age_ms == pytest.approx(-3.0, abs=0.1)


@given(st.lists(st.tuples(st.integers(0, NS_PER_S), st.integers(-NS_PER_S, NS_PER_S))))
def test_present_never_goes_back(samples):
    clock, host_ns, before = SourceClock(stamps_of_host=False), 0, None
    for wait_ns, ahead_ns in samples:
        host_ns += wait_ns
        clock.observe(host_ns + ahead_ns, host_ns)
        now = clock.now(host_ns)
        assert before is None or before <= now
        before = now


def test_number_of_unconfirmed_stamps_is_bounded():
    clock = SourceClock(stamps_of_host=False)
    tracked(clock, 0, 100)
    for index in range(1000):
        clock.observe(NS_PER_S * (100 + index), 100 * NS_PER_MS + index)
    assert len(clock._unconfirmed) == MAX_UNCONFIRMED


AHEAD_MS = 200


def queue_of(*stamps_ms):
    queue = JointQueue(AHEAD_MS * NS_PER_MS)
    for at_ms in stamps_ms:
        assert queue.add(joint_sample({"waist": 0.1}, at_ms))
    return queue


def taken_ms(queue, now_ms):
    return [sample.stamp.ns / NS_PER_MS for sample in queue.take(Stamp(now_ms * NS_PER_MS))]


def test_newest_joints_that_are_not_ahead_are_taken_once():
    queue = queue_of(10, 30, 20, 40)  # one came late, yet before it was needed
    assert taken_ms(queue, 9) == []
    assert taken_ms(queue, 30) == [30]
    assert taken_ms(queue, 39) == []
    assert not queue.add(joint_sample({"waist": 0.1}, 25))
    assert taken_ms(queue, 60) == [40]
    assert taken_ms(queue, 80) == []


def test_joints_further_ahead_than_the_limit_are_taken_at_once():
    assert taken_ms(queue_of(10, 210), 10) == [10]
    queue = queue_of(10, 211)
    assert taken_ms(queue, 10) == [211]
    assert queue.add(joint_sample({"waist": 0.1}, 20))  # the present has not reached 211
    assert taken_ms(queue, 20) == [20]


def test_queue_is_bounded_and_keeps_the_newest():
    queue = queue_of(*(0.5 * index for index in range(MAX_JOINTS + 50)))
    assert taken_ms(queue, 24) == []
    assert taken_ms(queue, 25) == [25]
    assert taken_ms(queue, 1000) == [0.5 * (MAX_JOINTS + 49)]
