"""``~/rearm`` is checked between two steps, after any wait for the current step."""

import json
import threading
from pathlib import Path

import pytest
from marginguard_msgs.msg import FixtureConstraint

from app.bridge.live import RearmService
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from tests.bridge.conftest import DEADLINE_S

CALLER = Path(__file__).resolve().parents[1] / "caller.py"
REARM = "/marginguard/rearm:marginguard_msgs/srv/Rearm"
REASONS = ["latched"]
KNOWN = FixtureConstraint(state=FixtureConstraint.WARNING, hold=True, reasons=REASONS)
UNKNOWN = FixtureConstraint(state=FixtureConstraint.UNKNOWN, hold=True, reasons=REASONS)
FREE = FixtureConstraint(state=FixtureConstraint.WARNING)


class CommandsDouble:
    """Test double of `OperatorCommands` whose step ends when ``stepping`` is released."""

    def __init__(self, stepping):
        self.rearmed = 0
        self.requested = threading.Event()
        self._stepping = stepping

    def rearm(self, check):
        self.requested.set()
        with self._stepping:
            check()
            self.rearmed += 1


class NoPublisher:
    """Test double of a publisher without subscribers."""

    def publish(self, raw):
        pass


@pytest.mark.parametrize("what", ["new tumour", "past fault", "no fault"])
def test_rearm_checks_faults_that_occur_while_it_waits_for_a_step(domain_id, start, what):
    stepping = threading.Lock()
    commands, stream = CommandsDouble(stepping), ConstraintStream(NoPublisher(), None)

    stream.publish(KNOWN)
    request = json.dumps({"seq": stream.seq, "nonce": stream.rearm_nonce})
    with RosNode("marginguard", domain_id=domain_id) as ros:
        RearmService(ros, stream, commands)
        with stepping:
            caller = start(str(CALLER), f"{REARM}:{request}")
            assert commands.requested.wait(DEADLINE_S)
            stream.publish(KNOWN)
            if what == "new tumour":
                stream.invalidate(UNKNOWN)
            elif what == "past fault":
                stream.publish(UNKNOWN)
                stream.publish(KNOWN)
        caller.line()
        reply = json.loads(caller.line())
    stream.close()
    assert reply["success"] is (what == "no fault")
    assert commands.rearmed == (1 if what == "no fault" else 0)
    assert ("a fault began" in reply["message"]) is (what != "no fault")


def test_guessed_seq_another_nonce_and_a_repeated_request_rearm_nothing(domain_id, start):
    commands = CommandsDouble(threading.Lock())
    stream = ConstraintStream(NoPublisher(), None)
    stream.publish(KNOWN)
    old = stream.rearm_nonce
    stream.publish(UNKNOWN)
    stream.publish(KNOWN)
    seq, nonce = stream.seq - 1, stream.rearm_nonce
    requests = [
        ({"seq": 2**64 - 1, "nonce": nonce}, "not published yet; expected at most 2"),
        ({"seq": 2**64 - 1, "nonce": 0}, "not published yet"),
        ({"seq": seq, "nonce": old}, f"nonce is {old}: not that of the present hold"),
        ({"seq": seq, "nonce": 0}, "nonce is 0"),
        ({"seq": seq, "nonce": nonce}, None),
        ({"seq": seq, "nonce": nonce}, "no hold is latched"),
    ]
    with RosNode("marginguard", domain_id=domain_id) as ros:
        RearmService(ros, stream, commands)
        caller = start(str(CALLER), *(f"{REARM}:{json.dumps(each)}" for each, _ in requests))
        caller.line()
        for _, refusal in requests:
            reply = json.loads(caller.line())
            assert reply["success"] is (refusal is None)
            assert (refusal or "") in reply["message"]
            assert str(nonce) not in reply["message"]
    assert commands.rearmed == 1
    stream.publish(FREE)
    assert stream.rearm_nonce == 0
    stream.close()
