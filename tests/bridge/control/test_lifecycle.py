"""Another process leads a node through its life cycle; only an active one speaks."""

import threading
from pathlib import Path

import pytest
from std_srvs.srv import Trigger

from app.bridge.control import ConstraintStream, LifecycleRosNode
from app.bridge.errors import BridgeError
from app.bridge.topics import CONSTRAINT
from tests.bridge.control.test_constraint_stream import constraint

CLIENT = Path(__file__).resolve().parent / "lifecycle_client.py"


class Speaker:
    """Streams one constraint while it is active; fails where it is told to."""

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
        self.stream.newest(constraint())

    def deactivate(self):
        self._note("deactivate")
        self.stream.rest("inactive")
        self.stream.close()

    def clean_up(self):
        self._note("clean_up")

    def _note(self, name):
        self.calls.append(name)
        if name in self.fails:
            raise self.fails.pop(name)


@pytest.fixture
def speaker():
    return Speaker()


@pytest.fixture
def ros(domain_id, speaker):
    with LifecycleRosNode("marginguard", speaker, domain_id=domain_id) as node:
        yield node


def lead(start_receiver, *words):
    client = start_receiver("marginguard", *words, script=CLIENT)
    return [next(iter(said.values())) for said in client.take(len(words))]


def test_a_whole_life(ros, speaker, start_receiver):
    assert lead(start_receiver, "state") == ["unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    found = lead(start_receiver, "configure", "state", "activate", "state")
    assert found == [True, "inactive", True, "active"]
    listener.wait_until_ready()
    listener.take(3)
    assert lead(start_receiver, "deactivate", "state") == [True, "inactive"]
    last = listener.take(1)[0]["message"]
    while not last["hold"]:
        last = listener.take(1)[0]["message"]
    assert (last["state"], last["reasons"]) == (3, ["inactive"])
    assert last["seq"] == speaker.stream.seq - 1  # nothing comes after it
    assert lead(start_receiver, "cleanup", "state") == [True, "unconfigured"]
    assert ros.node.count_publishers("/marginguard/constraint") == 0
    assert speaker.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_a_transition_that_is_not_possible_is_answered(ros, speaker, start_receiver):
    words = ("activate", "200", "nonsense", "state")
    assert lead(start_receiver, *words) == [False, False, False, "unconfigured"]
    assert speaker.calls == []


def test_what_is_refused_changes_no_state_and_a_fault_goes_back(ros, speaker, start_receiver):
    speaker.fails = {
        "configure": BridgeError("the case is not there"),
        "activate": ZeroDivisionError("a mistake"),
    }
    words = ("configure", "state", "configure", "activate", "state")
    found = lead(start_receiver, *words)
    assert found == [False, "unconfigured", True, False, "unconfigured"]
    assert speaker.calls == ["configure", "configure", "activate", "clean_up"]


def test_shutting_an_active_node_down_ends_what_it_did(ros, speaker, start_receiver):
    found = lead(start_receiver, "configure", "activate", "shutdown", "state")
    assert found == [True, True, True, "finalized"]
    assert speaker.calls == ["configure", "activate", "deactivate", "clean_up"]


def test_closing_an_active_node_says_hold_first(domain_id, speaker, start_receiver):
    ros = LifecycleRosNode("marginguard", speaker, domain_id=domain_id)
    listener = start_receiver(
        "/marginguard/constraint:marginguard_msgs/msg/FixtureConstraint:1000000", wait=False
    )
    assert lead(start_receiver, "configure", "activate") == [True, True]
    listener.wait_until_ready()
    listener.take(3)
    ros.close()
    ros.close()
    last = listener.take(1)[0]["message"]
    while not last["hold"]:
        last = listener.take(1)[0]["message"]
    assert (last["state"], last["reasons"]) == (3, ["inactive"])
    assert last["seq"] == speaker.stream.seq - 1
    assert speaker.calls == ["configure", "activate", "deactivate", "clean_up"]


class Half(Speaker):
    """Makes an endpoint of each kind, and fails with them there."""

    def configure(self, ros):
        super().configure(ros)
        ros.subscribe(CONSTRAINT, lambda message: None)
        ros.node.create_service(Trigger, "~/half", lambda request, response: response)
        ros.node.create_client(Trigger, "~/half")
        ros.node.create_timer(100.0, lambda: None)
        raise BridgeError("half way")


def test_a_configuration_that_fails_leaves_nothing_behind(domain_id, start_receiver):
    with LifecycleRosNode("marginguard", Half(), domain_id=domain_id) as ros:
        node = ros.node

        def made():
            kinds = (node.publishers, node.subscriptions, node.services, node.clients, node.timers)
            return [len(list(each)) for each in kinds]

        before = made()
        assert lead(start_receiver, "configure", "state") == [False, "unconfigured"]
        assert made() == before
