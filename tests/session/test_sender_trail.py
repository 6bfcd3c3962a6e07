"""Senders of one stream, against an oracle that knows which process has sent each sample."""

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import NS_PER_MS, NS_PER_S
from app.session.frame_senders import (
    DROPS_WITHIN_NS,
    ENDED_NS,
    HANDOVER_NS,
    LEASE_NS,
    SILENT_NS,
    Sample,
    SenderTrail,
    SequenceTrail,
)

PERIOD_NS = 16 * NS_PER_MS


def present(sender):
    return True


def gone(sender):
    return False


def sample(number, content="pose"):
    return Sample(number, content)


def send(trail, sender, begin_ns, end_ns, period_ns=PERIOD_NS, content=None):
    """Samples of ``sender`` from ``begin_ns`` up to ``end_ns``; returns those that are used."""
    content = sender if content is None else content
    return [
        ns
        for ns in range(begin_ns, end_ns, period_ns)
        if trail.observe(sender, sample(ns, content), ns)
    ]


def test_samples_of_one_sender_are_all_used_and_make_no_conflict():
    trail = SenderTrail()
    assert len(send(trail, "a", 0, NS_PER_S)) == len(range(0, NS_PER_S, PERIOD_NS))
    assert not trail.check(NS_PER_S, present)


def test_sample_of_a_second_sender_is_never_used_and_is_a_conflict_at_the_next_of_the_owner():
    trail = SenderTrail()
    send(trail, "a", 0, 10 * PERIOD_NS)
    assert not trail.observe("b", sample(10 * PERIOD_NS - 5, "b"), 10 * PERIOD_NS - 5)
    assert not trail.check(10 * PERIOD_NS - 5, present)
    assert trail.observe("a", sample(10 * PERIOD_NS, "a"), 10 * PERIOD_NS)
    assert trail.check(10 * PERIOD_NS, present) == {"a", "b"}


def test_second_sender_with_stamps_of_the_future_is_a_conflict_at_the_second_sample_of_the_owner():
    trail = SenderTrail()
    send(trail, "a", 0, 3)
    trail.observe("b", sample(10**15, "b"), 3)
    for ns in (4, 5):
        assert not trail.check(ns, present)
        trail.observe("a", sample(ns, "a"), ns)
    assert trail.check(5, present) == {"a", "b"}


@pytest.mark.parametrize("silent_ns", [HANDOVER_NS, NS_PER_S, 10 * LEASE_NS])
def test_restarted_sender_is_used_without_a_conflict(silent_ns):
    trail = SenderTrail()
    begin_ns = 0
    for number in range(40):  # more restarts than senders are remembered
        used = send(trail, f"run {number}", begin_ns, begin_ns + NS_PER_S)
        assert used[0] == begin_ns and len(used) == len(range(0, NS_PER_S, PERIOD_NS))
        begin_ns = used[-1] + silent_ns
        assert not trail.check(begin_ns, present)


def test_publisher_that_is_replaced_at_once_is_used_after_the_handover():
    trail = SenderTrail()
    last_ns = send(trail, "a", 0, NS_PER_S)[-1]
    used = send(trail, "b", last_ns + 1, last_ns + NS_PER_S)
    assert HANDOVER_NS <= used[0] - last_ns < HANDOVER_NS + PERIOD_NS
    assert not trail.check(used[-1], present)


@pytest.mark.parametrize("silent_ms", [100, 150, 299, 300, 2000])
def test_another_sender_that_takes_over_before_the_silence_is_noticed_is_a_conflict(silent_ms):
    trail, fresh_ns = SenderTrail(), 200 * NS_PER_MS
    send(trail, "a", 0, 1)
    now_ns = silent_ms * NS_PER_MS
    assert trail.observe("b", sample(now_ns, "b"), now_ns, fresh_ns)
    is_noticed = now_ns >= fresh_ns + HANDOVER_NS
    assert trail.check(now_ns, present) == (set() if is_noticed else {"a", "b"})
    ended_ns = now_ns + SILENT_NS
    trail.observe("b", sample(ended_ns, "b"), ended_ns, fresh_ns)
    assert not trail.check(ended_ns, lambda sender: sender == "b")


def test_earlier_owner_that_returns_after_a_handover_is_a_conflict():
    trail = SenderTrail()
    send(trail, "a", 0, NS_PER_S)
    send(trail, "b", 2 * NS_PER_S, 3 * NS_PER_S)
    trail.observe("a", sample(4 * NS_PER_S, "a"), 4 * NS_PER_S)
    assert trail.check(4 * NS_PER_S, present) == {"a", "b"}


def test_copies_are_used_and_make_no_conflict_whichever_comes_first():
    late, early = SenderTrail(), SenderTrail()
    for ns in range(0, NS_PER_S, PERIOD_NS):
        assert late.observe("a", sample(ns), ns)
        assert late.observe("relay", sample(ns), ns + 1)
        early.observe("a" if ns == 0 else "relay", sample(ns), ns)
        assert early.observe("a", sample(ns), ns + 1)
    assert not late.check(NS_PER_S, present)
    assert not early.check(NS_PER_S, present)


def test_copy_that_differs_in_content_or_stamp_is_a_conflict():
    for other in (sample(7, "other"), sample(8)):
        trail = SenderTrail()
        trail.observe("a", sample(7), 0)
        assert not trail.observe("relay", other, 1)
        for ns in (2, 3):
            trail.observe("a", sample(10 + ns), ns)
        assert trail.check(3, present) == {"a", "relay"}


@pytest.mark.parametrize(
    ("is_present", "ends_ns"), [(gone, SILENT_NS), (present, LEASE_NS)], ids=["left", "in graph"]
)
@pytest.mark.parametrize("remaining", ["a", "b"])
def test_conflict_ends_when_one_sender_has_ended_and_the_other_is_used_then(
    is_present, ends_ns, remaining
):
    trail = SenderTrail()
    for ns in range(0, NS_PER_S, PERIOD_NS):
        trail.observe("a", sample(ns, "a"), ns)
        trail.observe("b", sample(ns, "b"), ns)
    ended_ns = ns
    while trail.check(ns, is_present):
        ns += PERIOD_NS
        trail.observe(remaining, sample(ns, remaining), ns)
    assert ended_ns + ends_ns <= ns <= ended_ns + ends_ns + PERIOD_NS
    used = send(trail, remaining, ns + PERIOD_NS, ns + NS_PER_S)
    assert used[0] == ns + PERIOD_NS
    assert not trail.check(ns + NS_PER_S, is_present)


def test_memory_stays_bounded_with_many_senders():
    trail = SenderTrail()
    for ns in range(5000):
        trail.observe("a", sample(2 * ns, "a"), ns)
        trail.observe(f"b {ns}", sample(2 * ns + 1, ns), ns)
    sizes = [len(each) for each in vars(trail).values() if hasattr(each, "__len__")]
    assert max(sizes) <= 256
    assert "a" in trail.check(5000, present)


@st.composite
def runs(draw):
    """Runs of one driver, one after the other, and the samples that arrive of each."""
    now_ns, arrivals = 0, []
    for number in range(draw(st.integers(1, 4))):
        period_ns = draw(st.integers(1, 90)) * NS_PER_MS
        for _ in range(draw(st.integers(1, 30))):
            now_ns += draw(st.integers(1, 3)) * period_ns // 3 + 1  # jitter
            if draw(st.integers(0, 4)):  # a fifth is lost
                arrivals.append((f"run {number}", now_ns))
        now_ns += draw(st.integers(100, 5000)) * NS_PER_MS
    return arrivals


@given(runs())
def test_no_sequence_of_restarts_with_losses_and_jitter_is_a_conflict(arrivals):
    trail = SenderTrail()
    for sender, ns in arrivals:
        assert trail.observe(sender, sample(ns, sender), ns)
        assert not trail.check(ns, present)


@given(
    st.lists(st.sampled_from("ab"), min_size=3, max_size=40),
    st.lists(st.integers(1, 60 * NS_PER_MS), min_size=40, max_size=40),
)
def test_conflict_exactly_if_a_sender_returns_after_another_one(order, gaps_ns):
    """Within the handover time, whatever the rates, losses and stamps are."""
    trail, now_ns, numbers = SenderTrail(), 0, count()
    used = set()
    for sender, gap_ns in zip(order, gaps_ns, strict=False):
        now_ns += min(gap_ns, HANDOVER_NS // len(order))
        if trail.observe(sender, sample(next(numbers), sender), now_ns):
            used.add(sender)
    first = order[0]
    others = [index for index, sender in enumerate(order) if sender != first]
    returns = bool(others) and first in order[others[0] :]
    assert bool(trail.check(now_ns, present)) == returns
    assert used == {first}


def test_sequence_numbers_of_one_sender_and_its_restarts_make_no_conflict():
    trail = SequenceTrail()
    for run in range(5):
        begin_ns = run * (DROPS_WITHIN_NS + 1)
        for number in range(1, 100):
            trail.observe(number, (run, number), begin_ns + number)
            assert not trail.check(begin_ns + number)


@given(st.integers(1, 10_000), st.integers(1, 10_000), st.integers(1, 5), st.integers(0, 3))
def test_two_numbered_senders_are_a_conflict(first, second, rate, lost):
    """Two streams of any two numbers; one sends ``rate`` times as often, some are lost."""
    trail, now_ns = SequenceTrail(), 0
    for number in range(6):
        for sub in range(rate):
            now_ns += PERIOD_NS
            if sub != lost:
                trail.observe(first + number * rate + sub, ("a", number, sub), now_ns)
        trail.observe(second + number, ("b", number), now_ns)
        trail.observe(first + (number + 1) * rate, ("a", number, "last"), now_ns)
    assert trail.check(now_ns)


def test_numbered_conflict_ends_after_a_time_without_drops():
    trail = SequenceTrail()
    for number in range(4):
        trail.observe(100 + number, ("a", number), number)
        trail.observe(number, ("b", number), number)
    assert trail.check(3 + ENDED_NS - 1)
    assert not trail.check(3 + ENDED_NS)
    trail.observe(200, "later", 3 + ENDED_NS)
    assert not trail.check(3 + ENDED_NS)


def test_copies_of_a_relay_are_not_counted_as_numbered_senders():
    trail = SequenceTrail()
    for number in range(100):
        trail.observe(1000 + number, number, number)
        trail.observe(number, number, number)
    assert not trail.check(100)
