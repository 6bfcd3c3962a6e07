"""Senders of the frames of a topic: parents, loops, restarts."""

from app.geometry import NS_PER_MS, NS_PER_S
from app.session.frame_senders import LEASE_NS, MAX_FRAMES, FrameSenders, Sample, SenderConflict

USED = (("tracker", "cautery"), ("tracker", "reference"), ("reference", "needle"))
MS = NS_PER_MS


def listed(sender):
    return True


def send(senders, sender, edges, begin_ms, end_ms, period_ms=16):
    """Returns the edges of the samples that are used."""
    return {
        edge
        for ms in range(begin_ms, end_ms, period_ms)
        for edge in edges
        if senders.observe(edge, sender, Sample(ms * MS, sender), ms * MS)
    }


def found(senders, ms, frames=(), used=USED):
    return list(senders.conflicts(used, frames, ms * MS, listed))


def test_several_senders_of_different_frames_are_no_conflict():
    senders = FrameSenders()
    send(senders, "tracker", USED, 0, 100)
    send(senders, "robot", [("base", "link_1"), ("link_1", "link_2"), ("world", "base")], 0, 100)
    send(senders, "needle tracker", [("world", "tracker")], 50, 100)
    assert found(senders, 100) == []


def test_second_sender_of_a_frame_is_a_conflict_also_from_another_parent():
    for edge in (("tracker", "cautery"), ("odd", "cautery")):
        senders = FrameSenders()
        send(senders, "tracker", USED, 0, 100)
        assert send(senders, "other", [edge], 100, 110) == set()
        send(senders, "tracker", USED, 110, 200)
        assert found(senders, 200) == [
            SenderConflict(("tracker", "cautery"), frozenset({"tracker", "other"}))
        ]


def test_one_sender_may_measure_a_frame_from_several_parents():
    senders = FrameSenders()
    both = [*USED, ("reference", "cautery")]
    assert send(senders, "tracker", both, 0, 500) == set(both)
    assert send(senders, "restarted", both, 1500, 2000) == set(both)
    assert found(senders, 2000) == []


def test_frame_that_another_sender_takes_over_while_its_pose_is_in_use_is_a_conflict():
    senders = FrameSenders()
    send(senders, "tracker", USED, 0, 17)
    edge, fresh_ns = ("tracker", "cautery"), 200 * MS
    assert senders.observe(edge, "other", Sample(150 * MS, "other"), 150 * MS, fresh_ns)
    assert senders.has_conflict("cautery")
    assert found(senders, 150) == [SenderConflict(edge, frozenset({"tracker", "other"}))]


def test_second_sender_of_an_unused_frame_is_no_conflict_unless_it_is_listed():
    senders = FrameSenders()
    for ms in range(0, 100, 10):
        send(senders, "tracker", USED, ms, ms + 1)
        send(senders, "a", [("x", "y")], ms, ms + 1)
        send(senders, "b", [("x", "y")], ms, ms + 1)
    assert found(senders, 100) == []
    assert [each.edge for each in found(senders, 100, frames=["y"])] == [("x", "y")]


def test_edge_of_another_sender_that_closes_a_loop_is_refused_and_a_conflict():
    """The edge would be a shorter path from the tumour to the tool."""
    senders = FrameSenders()
    shortcut = ("needle", "tracker")
    send(senders, "tracker", USED, 0, 100)
    assert send(senders, "other", [shortcut], 100, 200) == set()
    assert found(senders, 200) == [
        SenderConflict(shortcut, frozenset({"tracker", "other"}), loop=True)
    ]
    ended_ms = 200 + LEASE_NS // MS
    send(senders, "tracker", USED, 200, ended_ms)
    assert found(senders, ended_ms) == []


def test_restarted_sender_that_adds_an_edge_closes_no_loop_with_its_earlier_run():
    senders = FrameSenders()
    send(senders, "first", USED, 0, 1000)
    assert send(senders, "second", [("reference", "cautery")], 1200, 1300)
    assert send(senders, "second", USED, 1300, 1400) == set(USED)
    assert found(senders, 1400) == []


def test_memory_is_bounded_and_named_frames_are_followed_after_a_flood():
    senders = FrameSenders(named=USED)
    for number in range(3 * MAX_FRAMES):
        edges = [("x", f"child {number}"), (f"parent {number}", "y")]
        assert send(senders, f"flood {number}", edges, number, number + 1)
    for ms in range(2000, 2100, 10):
        send(senders, "tracker", USED, ms, ms + 1)
        send(senders, "other", USED[:1], ms, ms + 1)
    assert [each.edge for each in found(senders, 2100)] == [("tracker", "cautery")]
    sizes = [len(each) for each in vars(senders).values() if hasattr(each, "__len__")]
    assert max(sizes) <= 2 * (MAX_FRAMES + len(USED))  # both ends of each edge


def test_senders_without_identity_are_a_conflict_by_their_sequence_numbers():
    senders = FrameSenders()
    for number in range(10):
        for edge in USED:
            senders.observe_sequence(edge, 500 + number, Sample(number, "a"), number * MS)
        senders.observe_sequence(USED[0], 20 + number, Sample(number, "b"), number * MS)
        senders.observe_sequence(("x", "y"), number, Sample(number, "c"), number * MS)
    assert found(senders, 10) == [SenderConflict(USED[0], frozenset())]
    assert found(senders, 10 + 20 * NS_PER_S // MS) == []
