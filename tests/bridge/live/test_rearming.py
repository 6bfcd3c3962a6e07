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
KNOWN = FixtureConstraint(state=FixtureConstraint.WARNING)
UNKNOWN = FixtureConstraint(state=FixtureConstraint.UNKNOWN, hold=True)


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
    seq = json.dumps({"seq": stream.seq})
    with RosNode("marginguard", domain_id=domain_id) as ros:
        RearmService(ros, stream, commands)
        with stepping:
            caller = start(str(CALLER), f"/marginguard/rearm:marginguard_msgs/srv/Rearm:{seq}")
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
