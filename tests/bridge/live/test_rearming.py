"""``~/rearm`` is checked between two steps, after any wait for the current step."""

import json
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.bridge.control.operator_requests import OperatorList, OperatorRequests
from app.bridge.control.operator_services import RearmService
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.runtime import OperatorCommands
from tests.bridge.conftest import DEADLINE_S
from tests.bridge.service_calls import CALLER

pytestmark = pytest.mark.slow

FLOOD = Path(__file__).with_name("rearm_flood.py")
REARM = "/marginguard/rearm:marginguard_msgs/srv/Rearm"
REASONS = ["latched"]
KNOWN = FixtureConstraint(state=FixtureConstraint.WARNING, hold=True, reasons=REASONS)


def held(*causes):
    """Constraint on hold with these causes; the state is known."""
    return FixtureConstraint(
        state=FixtureConstraint.WARNING, hold=True, reasons=REASONS, hold_causes=list(causes)
    )


UNKNOWN = FixtureConstraint(state=FixtureConstraint.UNKNOWN, hold=True, reasons=REASONS)
FREE = FixtureConstraint(state=FixtureConstraint.WARNING)


class SessionDouble:
    """Test double of a session: counts how often it is re-armed."""

    hold_causes = ()
    requested = SimpleNamespace(margins=None)
    rearmed = 0

    def rearm(self):
        self.rearmed += 1


class World:
    """Commands of a session whose step ends when ``stepping`` is released, and their service."""

    def __init__(self, ros):
        self.stepping, self.requested = threading.Lock(), threading.Event()
        self.session, self.stream = SessionDouble(), ConstraintStream(NoPublisher(), None)
        self.commands = OperatorCommands(self.between_steps, CONTENT, (), holds=self.stream)
        requests = OperatorRequests(ros, self.commands.requests, OperatorList(ros, None))
        RearmService(ros, self.commands, requests)

    @contextmanager
    def between_steps(self):
        self.requested.set()
        with self.stepping:
            yield self.session


@dataclass
class Content:
    """Test double of a content."""

    margins: None = None
    structures: tuple[()] = ()

    def with_margins(self, setup):
        return self


CONTENT = Content()


class NoPublisher:
    """Test double of a publisher without subscribers."""

    def publish(self, raw):
        pass


@pytest.fixture
def world(domain_id):
    with RosNode("marginguard", domain_id=domain_id) as ros:
        found = World(ros)
        yield found
        found.stream.close()


@pytest.mark.parametrize("what", ["new tumour", "past fault", "another cause", "no fault"])
def test_rearm_checks_faults_that_occur_while_it_waits_for_a_step(world, start, what):
    stream = world.stream
    stream.publish(held("stale"))
    request = json.dumps({"seq": stream.seq - 1, "nonce": stream.present().nonce})
    with world.stepping:
        caller = start(CALLER, f"{REARM}:{request}")
        assert world.requested.wait(DEADLINE_S)
        stream.publish(held("stale"))
        if what == "new tumour":
            stream.invalidate(UNKNOWN)
        elif what == "past fault":
            stream.publish(UNKNOWN)
            stream.publish(held("stale"))
        elif what == "another cause":
            stream.publish(held("stale", "stop_mm lowered from 2 to 1"))
    caller.line()
    reply = json.loads(caller.line())
    assert reply["success"] is (what == "no fault")
    assert world.session.rearmed == (1 if what == "no fault" else 0)
    assert ("a fault began" in reply["message"]) is (what != "no fault")


def test_guessed_seq_another_nonce_and_a_repeated_request_rearm_nothing(world, start):
    stream = world.stream
    stream.publish(KNOWN)
    old = stream.present().nonce
    stream.publish(UNKNOWN)
    stream.publish(KNOWN)
    seq, nonce = stream.seq - 1, stream.present().nonce
    requests = [
        ({"seq": 2**64 - 1, "nonce": nonce}, "not published yet; expected at most 2"),
        ({"seq": 2**64 - 1, "nonce": 0}, "not published yet"),
        ({"seq": seq, "nonce": old}, f"nonce is {old}: not that of the present hold"),
        ({"seq": seq, "nonce": 0}, "nonce is 0"),
        ({"seq": seq, "nonce": nonce}, None),
        ({"seq": seq, "nonce": nonce}, "no hold is latched"),
    ]
    caller = start(CALLER, *(f"{REARM}:{json.dumps(each)}" for each, _ in requests))
    caller.line()
    for _, refusal in requests:
        reply = json.loads(caller.line())
        assert reply["success"] is (refusal is None)
        assert (refusal or "") in reply["message"]
        assert str(nonce) not in reply["message"]
    assert world.session.rearmed == 1
    stream.publish(FREE)
    assert stream.present().nonce == 0


def test_invalid_request_takes_no_thread_and_does_not_wait_for_a_step(world, start):
    world.stream.publish(KNOWN)
    with world.stepping:  # a step that does not end
        caller = start(CALLER, f'{REARM}:{{"seq": 0, "nonce": 1}}')
        caller.line()
        assert "not that of the present hold" in json.loads(caller.line())["message"]
    assert not world.requested.is_set()
    assert not world.commands.requests.last.accepted


def test_first_valid_request_counts_in_a_flood_of_invalid_ones(world, start):
    world.stream.publish(KNOWN)
    flood = start(FLOOD, "300")
    flood.line()
    seq, nonce = world.stream.seq - 1, world.stream.present().nonce
    before = world.commands.requests.last
    caller = start(CALLER, f'{REARM}:{{"seq": {seq}, "nonce": {nonce}}}')
    caller.line()
    assert json.loads(caller.line())["success"]
    assert world.session.rearmed == 1
    assert not before.accepted  # of the flood
    assert flood.process.poll() is None


def test_latched_change_is_published_at_once_with_another_nonce():
    sent = []
    stream = ConstraintStream(SimpleNamespace(publish=sent.append), None)
    stream.latch(["nothing is published yet"])
    stream.publish(KNOWN)
    before = stream.present().nonce
    stream.latch(["stop_mm lowered from 2 to 1"])
    message = deserialize_message(sent[-1], FixtureConstraint)
    assert len(sent) == 2
    assert message.hold
    assert message.hold_causes == ["stop_mm lowered from 2 to 1"]
    assert message.rearm_nonce == stream.present().nonce not in (0, before)
    held_next = held("stop_mm lowered from 2 to 1")
    stream.publish(held_next)
    assert held_next.rearm_nonce == message.rearm_nonce
    assert stream.fault_seq == 1
    stream.close()
