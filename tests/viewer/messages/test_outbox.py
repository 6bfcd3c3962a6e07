"""Messages that are sent to one page, and those that are held back."""

import msgpack
import pytest

from app.viewer.messages.checks import MessageError
from app.viewer.messages.open_pages import MAX_ANSWERS, Outbox


def contents(frames):
    return [msgpack.unpackb(frame[12:])["result"] for frame in frames if len(frame) > 12]


def test_values_are_sent_with_the_picture_that_shows_them():
    outbox = Outbox()
    outbox.put_values({"now": 1, "look": "a"})
    outbox.put_values({"now": 2})
    outbox.put_picture(7, [b"picture"])
    values, picture = outbox.take()
    assert contents([values]) == [{"now": 2, "look": "a"}]
    assert picture == b"picture"
    assert outbox.take() == []


def test_until_the_acknowledgement_the_newest_values_and_picture_wait():
    outbox = Outbox()
    outbox.put_picture(1, [b"1"])
    assert outbox.take() == [b"1"]
    for number in (2, 3):
        outbox.put_values({"now": number})
        outbox.put_picture(number, [b"%d" % number])
    assert outbox.take() == []
    outbox.acknowledge(1)
    values, picture = outbox.take()
    assert (contents([values]), picture) == ([{"now": 3}], b"3")
    outbox.acknowledge(1)  # late
    outbox.put_picture(4, [b"4"])
    assert outbox.take() == []


def test_page_that_has_no_picture_gets_the_next_one():
    outbox = Outbox()
    outbox.put_picture(1, [b"1"])
    outbox.take()
    outbox.put_picture(2, [b"2"])
    outbox.acknowledge(0)
    assert outbox.take() == [b"2"]


def test_picture_that_was_not_sent_is_not_acknowledged():
    outbox = Outbox()
    outbox.put_picture(5, [b"5"])
    with pytest.raises(MessageError, match="picture: 5; expected at most 0"):
        outbox.acknowledge(5)


def test_answers_come_first_and_their_number_is_limited():
    outbox = Outbox()
    outbox.put_picture(1, [b"1"])
    outbox.put_other("beat", [b"old"])
    outbox.put_other("beat", [b"beat"])
    for number in range(MAX_ANSWERS):
        outbox.answer([b"%d" % number])
    with pytest.raises(MessageError, match="answers: 64 are not read"):
        outbox.answer([b"more"])
    sent = [outbox.take() for _ in range(MAX_ANSWERS + 3)]
    assert sent[0] == [b"0"]
    assert sent[MAX_ANSWERS:] == [[b"1"], [b"beat"], []]
