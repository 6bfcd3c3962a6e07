"""What the stream said to be stale holds the session, and twists, until somebody re-arms."""

from types import SimpleNamespace

from app.cli.live_guard import LiveGuard
from app.fixture import Reason
from tests.doubles import PARAMETERS
from tests.session.test_live import World, track


class Publisher:
    """Test double of a publisher whose stream had told ``late`` of its constraints to be stale."""

    def __init__(self, late):
        self.late, self.count = late, 0

        self.constraints = self
        self.last_words = []

    def publish(self, step):
        self.count += 1
        return self.count != self.late

    def rest(self, reason):
        self.last_words.append(reason)


class Twists:
    """Test double of a limiter: the steps that it was told to allow, None for none."""

    def __init__(self):
        self.allowed = []

    def allow(self, step, stale_after_ns):
        assert stale_after_ns == PARAMETERS.stale_after_ns
        self.allowed.append(step)

    def forbid(self):
        self.allowed.append(None)


def test_a_constraint_that_was_late_holds_what_follows_until_rearmed():
    world, twists = World(), Twists()
    track(world, 0, 400)
    world.at(300, world.live.rearm)
    world.at(390, world.live.stop)
    changes = SimpleNamespace(scene=SimpleNamespace(margins=PARAMETERS))
    publisher = Publisher(late=8)
    guard = LiveGuard(world.live, changes, None, publisher, twists, None)
    steps = list(guard.steps())
    assert twists.allowed == [*steps[:7], None, *steps[8:], None]
    assert publisher.last_words == ["inactive"]
    assert not any(step.decision.hold for step in steps[4:8])
    latched = [step.decision for step in steps[8:] if Reason.LATCHED in step.decision.reasons]
    assert latched == [step.decision for step in steps[8 : 8 + len(latched)]]
    assert len(latched) >= 5
    assert all(decision.hold and decision.constraint.hold for decision in latched)
    assert not steps[-1].decision.hold
