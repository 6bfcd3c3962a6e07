"""Lifecycle transitions requested by another process; only an active node publishes."""

import threading
from pathlib import Path

import pytest
from std_srvs.srv import Trigger

from app.bridge.control import LifecycleRosNode
from app.bridge.errors import BridgeError
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.bridge.topics import CONSTRAINT
from tests.bridge.publishing.test_constraint_stream import constraint

CLIENT = Path(__file__).resolve().parent / "lifecycle_client.py"


class StreamingNode:
    """Streams one constraint while active; raises the errors in `fails`."""

    def __init__(self):
        self.calls = []
        self.fails = {}
        self.beating = threading.Event()

    def configure(self, ros):
        self._note("configure")
        self.ros = ros
        self.publisher = ros.publisher(CONSTRAINT)

    def activate(self):
        self._note("activate")
        self.stream = ConstraintStream(self.publisher, 100.0)
        self.stream.publish(constraint())

    def deactivate(self):
        self._note("deactivate")
        self.stream.hold("inactive")
        self.stream.close()

    def clean_up(self):
        self._note("clean_up")

    def _note(self, name):
        self.calls.append(name)
        if name in self.fails:
            raise self.fails.pop(name)


@pytest.fixture
def streaming():
    return StreamingNode()


@pytest.fixture
def ros(domain_id, streaming):
    with LifecycleRosNode("marginguard", streaming, domain_id=domain_id) as node:
        yield node


def request(start_receiver, *requests):
    client = start_receiver("marginguard", *requests, script=CLIENT)
    return [next(iter(reply.values())) for reply in client.take(len(requests))]


def test_all_lifecycle_transitions(ros, streaming, start_receiver):
    assert request(start_receiver, "state") == ["unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    found = request(start_receiver, "configure", "state", "activate", "state")
    assert found == [True, "inactive", True, "active"]
    listener.wait_until_ready()
    listener.take(3)
    assert request(start_receiver, "deactivate", "state") == [True, "inactive"]
    last = listener.take(1)[0]["message"]
    while not last["hold"]:
        last = listener.take(1)[0]["message"]
    assert (last["state"], last["reasons"]) == (3, ["inactive"])
    assert last["seq"] == streaming.stream.seq - 1  # it is the last message
    assert request(start_receiver, "cleanup", "state") == [True, "unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    assert streaming.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_invalid_transition_gets_a_reply(ros, streaming, start_receiver):
    requests = ("activate", "200", "nonsense", "state")
    assert request(start_receiver, *requests) == [False, False, False, "unconfigured"]
    assert streaming.calls == []


def test_refused_transition_keeps_the_state_and_failure_returns_to_unconfigured(
    ros, streaming, start_receiver
):
    streaming.fails = {
        "configure": BridgeError("the case is not there"),
        "activate": ZeroDivisionError("a mistake"),
    }
    requests = ("configure", "state", "configure", "activate", "state")
    found = request(start_receiver, *requests)
    assert found == [False, "unconfigured", True, False, "unconfigured"]
    assert streaming.calls == ["configure", "configure", "activate", "clean_up"]


def test_shutdown_of_an_active_node_deactivates_and_cleans_up(ros, streaming, start_receiver):
    found = request(start_receiver, "configure", "activate", "shutdown", "state")
    assert found == [True, True, True, "finalized"]
    assert streaming.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_closing_an_active_node_publishes_hold_first(domain_id, streaming, start_receiver):
    ros = LifecycleRosNode("marginguard", streaming, domain_id=domain_id)
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    assert request(start_receiver, "configure", "activate") == [True, True]
    listener.wait_until_ready()
    listener.take(3)
    ros.close()
    ros.close()
    last = listener.take(1)[0]["message"]
    while not last["hold"]:
        last = listener.take(1)[0]["message"]
    assert (last["state"], last["reasons"]) == (3, ["inactive"])
    assert last["seq"] == streaming.stream.seq - 1
    assert streaming.calls == ["configure", "activate", "deactivate", "clean_up"]


class FailingNode(StreamingNode):
    """Creates an endpoint of each kind in `configure`, then fails."""

    def configure(self, ros):
        super().configure(ros)
        ros.subscribe(CONSTRAINT, lambda message: None)
        ros.node.create_service(Trigger, "~/unused", lambda request, response: response)
        ros.node.create_client(Trigger, "~/unused")
        ros.node.create_timer(100.0, lambda: None)
        raise BridgeError("configuration failed")


def test_failed_configuration_destroys_its_endpoints(domain_id, start_receiver):
    with LifecycleRosNode("marginguard", FailingNode(), domain_id=domain_id) as ros:
        node = ros.node

        def endpoints():
            kinds = (node.publishers, node.subscriptions, node.services, node.clients, node.timers)
            return [len(list(each)) for each in kinds]

        before = endpoints()
        assert request(start_receiver, "configure", "state") == [False, "unconfigured"]
        assert endpoints() == before
