"""Origin of received messages: the publisher's identity and its sequence numbers."""

import threading

import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from app.bridge import message_origin
from app.bridge.message_origin import Origin, Receiver, sender_of
from app.bridge.node import RosNode
from app.bridge.topics import STREAM, TF, Topic
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE, HERE
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

WORDS = Topic("/words", String, STREAM)


class Collector:
    """Collects messages with their origin until there are ``count``."""

    def __init__(self, count):
        self.found = []
        self._count = count
        self._done = threading.Event()

    def __call__(self, data, origin):
        self.found.append((data, origin))
        if len(self.found) >= self._count:
            self._done.set()

    def wait(self):
        assert self._done.wait(DEADLINE_S)
        return self.found


def gids(node, topic):
    return {bytes(each.endpoint_gid) for each in node.get_publishers_info_by_topic(topic)}


def test_origin_is_the_publishers_identifier_on_the_graph_and_its_sequence_number(domain_id):
    collector = Collector(6)
    with ros_nodes(domain_id, "receiver", "first", "second") as (ros, first, second):
        ros.subscribe_with_origin(WORDS, collector)
        publishers = [node.publisher(WORDS) for node in (first, second)]
        for node in (first, second):
            assert node.wait_for_subscribers(WORDS, 1, DEADLINE_S)
        for number in range(3):
            for name, publisher in zip("ab", publishers, strict=True):
                publisher.publish(String(data=f"{name}{number}"))
        found = collector.wait()
        senders = [sender_of(publisher) for publisher in publishers]
        assert set(senders) == gids(ros.node, "/words")
    received = {deserialize_message(data, String).data: origin[:2] for data, origin in found}
    assert received == {
        f"{name}{number}": (sender, number + 1)
        for name, sender in zip("ab", senders, strict=True)
        for number in range(3)
    }


def test_message_whose_callback_fails_does_not_take_the_next_ones_with_it(domain_id):
    blocked = threading.Event()
    collector = Collector(3)

    def receive(data, origin):
        blocked.wait(DEADLINE_S)  # the others wait meanwhile, and are taken together
        collector(data, origin)
        if len(collector.found) == 1:
            raise RuntimeError("the first message")

    with ros_nodes(domain_id, "receiver", "sender") as (ros, sender):
        ros.subscribe_with_origin(WORDS, receive)
        ros.call_soon(lambda: blocked.wait(DEADLINE_S))
        publisher = sender.publisher(WORDS)
        assert sender.wait_for_subscribers(WORDS, 1, DEADLINE_S)
        for number in range(3):
            publisher.publish(String(data=str(number)))
        sender.flush()
        blocked.set()
        found = [deserialize_message(data, String).data for data, _ in collector.wait()]
        ros.call(lambda: None)
        assert ros.failures == 1
    assert found == ["0", "1", "2"]


def test_subscription_that_is_destroyed_in_its_callback_receives_no_more(domain_id):
    found, held, looked = [], threading.Event(), threading.Event()
    with ros_nodes(domain_id, "receiver", "sender") as (ros, sender):

        def receive(data):
            found.append(data)
            ros.destroy_subscription(subscription)
            ros.call_soon(looked.set)

        subscription = ros.subscribe(WORDS, receive, raw=True)
        publisher = sender.publisher(WORDS)
        assert sender.wait_for_subscribers(WORDS, 1, DEADLINE_S)
        ros.call_soon(held.wait)  # so that all messages wait together
        for number in range(5):
            publisher.publish(String(data=str(number)))
        sender.flush()
        held.set()
        assert looked.wait(DEADLINE_S)
    assert len(found) == 1


def test_sender_without_ros_is_identified_as_on_the_graph(domain_id, start, monkeypatch):
    for name, value in CYCLONE_ON_THIS_MACHINE.items():
        monkeypatch.setenv(name, value)
    collector = Collector(3)
    with RosNode("receiver", domain_id=domain_id) as ros:
        ros.subscribe_with_origin(TF, collector)
        ros.subscribe(TF, lambda message: None)  # the peer waits for two readers
        peer = start(str(HERE / "cyclone_tracker.py"))
        peer.line(lambda line: line == "ready\n")
        for _ in range(3):
            peer.send("")
        found = collector.wait()
        assert {origin.sender for _, origin in found} == gids(ros.node, "/tf")
        assert [origin.sequence for _, origin in found] == [1, 2, 3]
    assert deserialize_message(found[0][0], TFMessage).transforms[0].child_frame_id == "sent_0"


def library_of_another_middleware():
    """The address of the middleware's name is not where the structure of Jazzy has it."""
    rcl = message_origin.Rcl()
    rcl.implementation += 1
    return rcl


@pytest.mark.parametrize("load", [lambda: None, library_of_another_middleware])
def test_without_a_known_library_the_sender_is_unknown_and_rclpy_gives_the_sequence(
    domain_id, monkeypatch, load
):
    library = load()
    monkeypatch.setattr(message_origin, "loaded_rcl", lambda: library)
    collector = Collector(2)
    with RosNode("receiver", domain_id=domain_id) as ros:
        ros.subscribe_with_origin(WORDS, collector)
        publisher = ros.publisher(WORDS)
        assert ros.wait_for_subscribers(WORDS, 1, DEADLINE_S)
        for _ in range(2):
            publisher.publish(String(data="word"))
        found = collector.wait()
        assert sender_of(publisher) is None
    assert [origin[:2] for _, origin in found] == [(None, 1), (None, 2)]
    assert all(0 < each.published_ns <= each.received_ns for _, each in found)
    assert {deserialize_message(data, String).data for data, _ in found} == {"word"}


def test_large_and_empty_messages_arrive_unchanged(domain_id):
    texts = ["", "x" * 1_000_000, "y"]
    collector = Collector(len(texts))
    with RosNode("receiver", domain_id=domain_id) as ros:
        ros.subscribe_with_origin(WORDS, collector)
        publisher = ros.publisher(WORDS)
        assert ros.wait_for_subscribers(WORDS, 1, DEADLINE_S)
        for text in texts:
            publisher.publish(String(data=text))
        found = collector.wait()
    assert [deserialize_message(data, String).data for data, _ in found] == texts


def test_receiver_accepts_the_mapping_of_rclpy():
    found = []
    Receiver(lambda data, origin: found.append((data, origin)))(
        b"data", {"publication_sequence_number": 7, "source_timestamp": 5, "received_timestamp": 6}
    )
    assert found == [(b"data", Origin(None, 7, 5, 6))]


def test_unsupported_sequence_number_is_none():
    assert message_origin._sequence(2**64 - 1) is None
    assert message_origin._sequence(5) == 5
