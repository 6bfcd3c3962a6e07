"""Queue of the messages of a topic."""

import pytest

from app.bridge.convert import ConversionError, TopicQueue, qos_profile

pytestmark = pytest.mark.slow

STRING = "std_msgs/msg/String"


def test_full_queue_drops_the_oldest_and_counts_them(ros):
    queue = TopicQueue(ros, STRING, "/text", qos_profile(depth=3))
    texts = ("a", "b", "c", "d", "e")
    for text in texts:  # CDR: header, length including the zero, characters
        queue._on_message(b"\x00\x01\x00\x00\x02\x00\x00\x00" + text.encode() + b"\x00")
    assert [queue.read(raw).data for raw in queue.take()] == ["c", "d", "e"]
    assert queue.lost == 2
    assert queue.take() == []


def test_invalid_bytes_in_queue_are_refused(ros):
    queue = TopicQueue(ros, STRING, "/text", qos_profile())
    with pytest.raises(ConversionError, match="/text: 3 bytes are not a valid String"):
        queue.read(b"\x00\x01\x00")


def test_closed_queue_has_left_the_graph(ros):
    queue = TopicQueue(ros, STRING, "/text", qos_profile())
    assert ros.node.count_subscribers("/text") == 1
    queue.close()
    assert ros.node.count_subscribers("/text") == 0
