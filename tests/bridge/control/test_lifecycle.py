"""Lifecycle transitions requested by another process; only an active node publishes."""

import threading
from functools import partial

import pytest
from std_srvs.srv import Trigger

from app.bridge.control.lifecycle import LifecycleRosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import CONSTRAINT
from tests.bridge.publishing.test_constraint_stream import constraint
from tests.bridge.service_calls import transitions

pytestmark = pytest.mark.slow


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


@pytest.fixture
def request_of(start_receiver):
    """``request_of("configure", "state")``: the results of another process's requests."""
    return partial(transitions, start_receiver)


def test_all_lifecycle_transitions(ros, streaming, start_receiver, request_of):
    assert request_of("state") == ["unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    found = request_of("configure", "state", "activate", "state")
    assert found == [True, "inactive", True, "active"]
    listener.wait_until_ready()
    listener.take(3)
    assert request_of("deactivate", "state") == [True, "inactive"]
    last = listener.until(lambda message: message["hold"])
    assert (last["state"], last["reasons"]) == (3, ["inactive"])
    assert last["seq"] == streaming.stream.seq - 1  # it is the last message
    assert request_of("cleanup", "state") == [True, "unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    assert streaming.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_invalid_transition_gets_a_reply(ros, streaming, request_of):
    requests = ("activate", "200", "nonsense", "state")
    assert request_of(*requests) == [False, False, False, "unconfigured"]
    assert streaming.calls == []


def test_refused_transition_keeps_the_state_and_failure_returns_to_unconfigured(
    ros, streaming, request_of
):
    streaming.fails = {
        "configure": BridgeError("the case is not there"),
        "activate": ZeroDivisionError("a mistake"),
    }
    requests = ("configure", "state", "configure", "activate", "state")
    found = request_of(*requests)
    assert found == [False, "unconfigured", True, False, "unconfigured"]
    assert streaming.calls == ["configure", "configure", "activate", "clean_up"]


def test_shutdown_of_an_active_node_deactivates_and_cleans_up(ros, streaming, request_of):
    found = request_of("configure", "activate", "shutdown", "state")
    assert found == [True, True, True, "finalized"]
    assert streaming.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_closing_an_active_node_publishes_hold_first(
    domain_id, streaming, start_receiver, request_of
):
    ros = LifecycleRosNode("marginguard", streaming, domain_id=domain_id)
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    assert request_of("configure", "activate") == [True, True]
    listener.wait_until_ready()
    listener.take(3)
    ros.close()
    ros.close()
    last = listener.until(lambda message: message["hold"])
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


def test_failed_configuration_destroys_its_endpoints(domain_id, request_of):
    with LifecycleRosNode("marginguard", FailingNode(), domain_id=domain_id) as ros:
        node = ros.node

        def endpoints():
            kinds = (node.publishers, node.subscriptions, node.services, node.clients, node.timers)
            return [len(list(each)) for each in kinds]

        before = endpoints()
        assert request_of("configure", "state") == [False, "unconfigured"]
        assert endpoints() == before
