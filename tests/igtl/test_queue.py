"""Sample queue and backoff."""

import threading

from app.geometry import Stamp, TrackedTransform, TrackingStatus
from app.igtl.source import Backoff, SampleQueue
from tests.waiting import DEADLINE_S


def sample(source: str, ns: int) -> TrackedTransform:
    return TrackedTransform.lost("tracker", source, Stamp(ns), TrackingStatus.MISSING)


def test_backoff_doubles_to_its_limit_and_resets():
    backoff = Backoff(0.25, 1.5)
    assert [backoff.next_s() for _ in range(5)] == [0.25, 0.5, 1.0, 1.5, 1.5]
    backoff.reset()
    assert backoff.next_s() == 0.25


def test_queue_is_fifo_below_its_limit():
    queue = SampleQueue(max_samples=4)
    sent = [sample("a", 1), sample("b", 1), sample("a", 2)]
    queue.put(sent[:2])
    queue.put(sent[2:])
    assert queue.take(0.0) == sent
    assert queue.take(0.0) == []
    assert queue.superseded == 0


def test_full_queue_keeps_the_newest_sample_of_each_edge():
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


def test_clear_discards_samples_and_close_wakes_the_reader():
    queue = SampleQueue()
    queue.put([sample("a", 1)])
    queue.clear()
    assert queue.take(0.0) == []
    taken: list[object] = []
    reader = threading.Thread(target=lambda: taken.append(queue.take(60.0)))
    reader.start()
    queue.close()
    reader.join(DEADLINE_S)
    assert taken == [None]
