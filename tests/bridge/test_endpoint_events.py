"""Events of endpoints reach their callbacks, also while endpoints are destroyed."""

import threading

import pytest
from std_msgs.msg import String

from app.bridge.node import RosNode
from app.bridge.topics import INCOMING, LATCHED, STREAM, Topic
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

WORDS = [Topic(f"/words_{number}", String, STREAM) for number in range(4)]


def test_subscribers_are_found_on_every_topic(domain_id):
    with RosNode("a", domain_id=domain_id) as ros, RosNode("b", domain_id=domain_id) as other:
        for topic in WORDS:
            ros.publisher(topic)
        for topic in WORDS:
            other.subscribe(topic, lambda message: None)
        assert all(ros.wait_for_subscribers(topic, 1, DEADLINE_S) for topic in WORDS)


def test_incompatible_endpoints_are_found_on_every_topic(domain_id):
    with RosNode("a", domain_id=domain_id) as ros, RosNode("b", domain_id=domain_id) as other:
        for topic in WORDS:
            ros.subscribe(Topic(topic.name, String, LATCHED), lambda message: None)
        for topic in WORDS:
            other.publisher(Topic(topic.name, String, INCOMING))
        found = threading.Event()
        watch = ros.every(0.05, lambda: found.set() if len(ros.incompatible) == 4 else None)
        assert found.wait(DEADLINE_S), ros.incompatible
        ros.cancel(watch)


def test_endpoints_are_destroyed_with_their_events(domain_id):
    with RosNode("a", domain_id=domain_id) as ros, RosNode("b", domain_id=domain_id) as other:
        publishers = [ros.publisher(topic) for topic in WORDS]
        subscriptions = [ros.subscribe(topic, lambda message: None) for topic in WORDS]
        ros.call(lambda: None)
        ros.call(lambda: ros.destroy_publisher(publishers[1]))
        ros.call(lambda: ros.destroy_subscription(subscriptions[2]))
        ros.call(lambda: None)
        assert publishers[1] not in ros.node.publishers
        assert subscriptions[2] not in ros.node.subscriptions
        # The events of the others still arrive.
        other.subscribe(WORDS[0], lambda message: None)
        assert ros.wait_for_subscribers(WORDS[0], 2, DEADLINE_S)
        assert ros.failures == 0
