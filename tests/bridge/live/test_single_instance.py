"""Publishers on the graph at a start: none, a silent one, a guard that sends."""

import threading

import pytest

from app.bridge import RosNode, topics
from app.bridge.live import single_instance
from app.bridge.live.single_instance import find_silent_publishers
from app.bridge.ros_errors import BridgeError
from app.fixture import Reason
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

TOPIC = "/marginguard/constraint"


@pytest.fixture
def ros(domain_id):
    """The node of the guard that starts."""
    with RosNode("marginguard_new", domain_id=domain_id) as node:
        yield node


@pytest.fixture
def silent(domain_id):
    """A node with a publisher of the constraint, as one of a killed process that is still known."""
    with RosNode("marginguard", domain_id=domain_id) as node:
        node.publisher(topics.CONSTRAINT)
        yield node


def test_no_publisher_is_no_fault(domain_id, ros):
    found = find_silent_publishers("marginguard", "/", domain_id)
    assert (found.topic, found.gids) == (TOPIC, frozenset())
    assert found.faults(ros) == {}


def test_publisher_that_sends_nothing_is_a_fault_until_it_is_gone(domain_id, ros, silent):
    found = find_silent_publishers("marginguard", "/", domain_id)
    assert len(found.gids) == 1
    assert wait_until(lambda: found.faults(ros)).keys() == {Reason.SECOND_SENDER}
    silent.close()
    wait_until(lambda: not found.faults(ros))


def test_publisher_that_stays_longer_than_the_lease_is_an_error(
    domain_id, ros, silent, monkeypatch
):
    found = find_silent_publishers("marginguard", "/", domain_id)
    monkeypatch.setattr(single_instance, "LEASE_S", 0.0)
    with pytest.raises(BridgeError, match=f"{TOPIC}: node /marginguard still has a publisher"):
        found.faults(ros)


def test_guard_that_sends_is_an_error_that_names_its_node(domain_id, silent):
    from marginguard_msgs.msg import FixtureConstraint

    ended = threading.Event()
    publisher = silent.publisher(topics.CONSTRAINT)

    def send():
        while not ended.wait(0.01):
            publisher.publish(FixtureConstraint())

    sender = threading.Thread(target=send)
    sender.start()
    try:
        with pytest.raises(BridgeError, match=f"{TOPIC}: node /marginguard publishes"):
            find_silent_publishers("marginguard", "", domain_id)
        other = find_silent_publishers("marginguard", "watch", domain_id)
        assert other.gids == frozenset()
    finally:
        ended.set()
        sender.join()
