"""One item from thread to thread: the newest, at once."""

import threading

from app.runtime.latest_value import LatestValue

DEADLINE_S = 60.0


def test_the_newest_item_is_taken_once():
    mailbox = LatestValue[int]()
    for number in range(5):
        mailbox.put(number)
    assert mailbox.take(0.0) == 4
    assert mailbox.take(0.0) is None
    assert mailbox.superseded == 4


def test_who_takes_what_is_there_misses_nothing():
    mailbox = LatestValue[int]()
    taken = []
    for number in range(5):
        mailbox.put(number)
        taken.append(mailbox.take(0.0))
    assert taken == [0, 1, 2, 3, 4]
    assert mailbox.superseded == 0


def test_what_means_false_is_an_item_too():
    mailbox = LatestValue[int]()
    mailbox.put(0)
    assert mailbox.take(0.0) == 0


def test_a_reader_that_waits_is_woken_by_each_item():
    there, back = LatestValue[int](), LatestValue[int]()

    def answer():
        while (number := there.take(DEADLINE_S)) is not None and number >= 0:
            back.put(10 * number)

    thread = threading.Thread(target=answer)
    thread.start()
    for number in range(200):
        there.put(number)
        assert back.take(DEADLINE_S) == 10 * number
    there.put(-1)
    thread.join(DEADLINE_S)
    assert not thread.is_alive()
    assert there.superseded == back.superseded == 0
