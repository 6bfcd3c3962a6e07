"""``~/rearm`` looks at everything between two steps, however long it had to wait for that."""

import json
import threading
from contextlib import contextmanager
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


class Session:
    """Test double: counts how often it was re-armed."""

    def __init__(self):
        self.rearmed = 0

    def rearm(self):
        self.rearmed += 1


class Nobody:
    """Test double of a publisher that nobody hears."""

    def publish(self, raw):
        pass


@pytest.mark.parametrize("what", ["another tumour", "a fault that is over", "nothing"])
def test_what_happens_while_it_waits_for_a_step_is_looked_at(domain_id, start, what):
    stepping, wanted = threading.Lock(), threading.Event()
    session, stream = Session(), ConstraintStream(Nobody(), None)

    @contextmanager
    def between_steps():
        wanted.set()
        with stepping:
            yield session

    stream.publish(KNOWN)
    seq = json.dumps({"seq": stream.seq})
    with RosNode("marginguard", domain_id=domain_id) as ros:
        RearmService(ros, stream, between_steps)
        with stepping:
            caller = start(str(CALLER), f"/marginguard/rearm:marginguard_msgs/srv/Rearm:{seq}")
            assert wanted.wait(DEADLINE_S)
            stream.publish(KNOWN)
            if what == "another tumour":
                stream.invalidate(UNKNOWN)
            elif what == "a fault that is over":
                stream.publish(UNKNOWN)
                stream.publish(KNOWN)
        caller.line()
        reply = json.loads(caller.line())
    stream.close()
    assert reply["success"] is (what == "nothing")
    assert session.rearmed == (1 if what == "nothing" else 0)
    assert ("a fault began" in reply["message"]) is (what != "nothing")
