"""Everything in order, or the newest of each edge."""

import threading

from app.geometry import Stamp, TrackedTransform, TrackingStatus
from app.igtl.backoff import Backoff
from app.igtl.queue import SampleQueue


def sample(source: str, ns: int) -> TrackedTransform:
    return TrackedTransform.lost("tracker", source, Stamp(ns), TrackingStatus.MISSING)


def test_waits_grow_to_a_bound_and_begin_anew() -> None:
    backoff = Backoff(0.25, 1.5)
    assert [backoff.next_s() for _ in range(5)] == [0.25, 0.5, 1.0, 1.5, 1.5]
    backoff.reset()
    assert backoff.next_s() == 0.25


def test_all_is_kept_in_order_while_there_is_room() -> None:
    queue = SampleQueue(max_samples=4)
    sent = [sample("a", 1), sample("b", 1), sample("a", 2)]
    queue.put(sent[:2])
    queue.put(sent[2:])
    assert queue.take(0.0) == sent
    assert queue.take(0.0) == []
    assert queue.superseded == 0


def test_of_a_flood_the_newest_of_each_edge_is_kept() -> None:
    queue = SampleQueue(max_samples=10)
    for ns in range(1, 10_001):
        queue.put([sample("a", ns)])
        if ns == 5_000:
            queue.put([sample("b", ns)])
    taken = queue.take(0.0)
    assert taken is not None
    assert len(taken) <= 10
    assert {each.source: each.stamp.ns for each in taken} == {"a": 10_000, "b": 5_000}
    assert queue.superseded == 10_001 - len(taken)


def test_what_is_cleared_is_gone_and_close_wakes_the_taker() -> None:
    queue = SampleQueue()
    queue.put([sample("a", 1)])
    queue.clear()
    assert queue.take(0.0) == []
    taken: list[object] = []
    taker = threading.Thread(target=lambda: taken.append(queue.take(60.0)))
    taker.start()
    queue.close()
    taker.join(60.0)
    assert taken == [None]
