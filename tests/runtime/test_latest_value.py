"""The newest value is passed between threads, once."""

import threading

from app.runtime.thread_handover import LatestValue

DEADLINE_S = 60.0


def test_newest_item_is_taken_once():
    latest = LatestValue[int]()
    for number in range(5):
        latest.put(number)
    assert latest.take(0.0) == 4
    assert latest.take(0.0) is None


def test_fast_reader_gets_every_item():
    latest = LatestValue[int]()
    taken = []
    for number in range(5):
        latest.put(number)
        taken.append(latest.take(0.0))
    assert taken == [0, 1, 2, 3, 4]


def test_falsy_value_is_an_item():
    latest = LatestValue[int]()
    latest.put(0)
    assert latest.take(0.0) == 0


def test_waiting_reader_is_woken_by_each_item():
    requests, replies = LatestValue[int](), LatestValue[int]()

    def reply():
        while (number := requests.take(DEADLINE_S)) is not None and number >= 0:
            replies.put(10 * number)

    thread = threading.Thread(target=reply)
    thread.start()
    for number in range(200):
        requests.put(number)
        assert replies.take(DEADLINE_S) == 10 * number
    requests.put(-1)
    thread.join(DEADLINE_S)
    assert not thread.is_alive()
