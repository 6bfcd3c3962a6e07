"""What the stream said to be stale holds the session, and twists, until somebody re-arms."""

import threading
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from app.bridge.live import LiveNode, LiveNodeLifecycle
from app.bridge.live.live_node import SessionOutputs
from app.fixture import Reason
from tests.doubles import PARAMETERS
from tests.session.test_live import World, track

CHANGES = SimpleNamespace(scene=SimpleNamespace(margins=PARAMETERS))


class Publisher:
    """Test double of a publisher whose stream had told ``late`` of its constraints to be stale."""

    def __init__(self, late):
        self.late, self.count = late, 0

        self.constraints = self
        self.last_words = []

    def publish(self, step, spent_ns):
        assert spent_ns == 0
        self.count += 1
        return self.count != self.late

    def rest(self, reason):
        self.last_words.append(reason)


class Twists:
    """Test double of a limiter: the steps that it was told to allow, None for none."""

    def __init__(self):
        self.allowed = []
        self.spent_ns = []

    def allow(self, step, stale_after_ns, spent_ns):
        assert stale_after_ns == PARAMETERS.stale_after_ns
        self.allowed.append(step)
        self.spent_ns.append(spent_ns)

    def forbid(self):
        self.allowed.append(None)


def test_a_constraint_that_was_late_holds_what_follows_until_rearmed():
    world, twists = World(), Twists()
    track(world, 0, 400)
    world.at(300, world.rearm)
    world.at(390, world.live.stop)
    publisher = Publisher(late=8)
    guard = LiveNode(world.live, CHANGES, None, publisher, twists, None)
    steps = list(guard.steps())
    assert twists.allowed == [*steps[:7], None, *steps[8:], None]
    assert publisher.last_words == ["inactive"]
    assert not any(step.decision.hold for step in steps[4:8])
    latched = [step.decision for step in steps[8:] if Reason.LATCHED in step.decision.reasons]
    assert latched == [step.decision for step in steps[8 : 8 + len(latched)]]
    assert len(latched) >= 5
    assert all(decision.hold and decision.constraint.hold for decision in latched)
    assert not steps[-1].decision.hold


def test_what_is_allowed_ends_no_later_because_publishing_took_long():
    world, twists = World(), Twists()
    track(world, 0, 100)
    world.at(90, world.live.stop)

    class Slow(Publisher):
        def publish(self, step, spent_ns):
            world.ns += 7
            return super().publish(step, spent_ns)

    publisher = Slow(late=0)
    assert list(LiveNode(world.live, CHANGES, None, publisher, twists, None).steps())
    assert set(twists.spent_ns) == {7}


def test_an_error_leaves_nothing_allowed_and_the_session_to_others():
    world, twists = World(), Twists()
    track(world, 0, 400)

    class Failing(Publisher):
        def publish(self, step, spent_ns):
            if self.count == 5:
                raise OSError("the wire is cut")
            return super().publish(step, spent_ns)

        def rest(self, reason):
            super().rest(reason)
            raise OSError("the wire is still cut")

    publisher = Failing(late=0)
    guard = LiveNode(world.live, CHANGES, None, publisher, twists, None)
    with pytest.raises(OSError, match="still cut") as raised:
        list(guard.steps())
    assert "the wire is cut" in str(raised.value.__context__)
    assert twists.allowed[-1] is None
    assert publisher.last_words == ["inactive"]
    with world.live.between_steps() as session:
        assert session is not None


def test_what_the_last_step_allowed_ends_with_what_it_was_allowed_by():
    twists, shown = Twists(), []
    publisher = SimpleNamespace(use=lambda *scene: shown.append((scene, list(twists.allowed))))
    SessionOutputs(publisher, twists).use("scene", "shapes")
    assert shown == [(("scene", "shapes"), [None])]


def test_a_guard_that_fails_is_no_active_node_that_says_nothing():
    """The thread that follows the steps hands its error to whoever can end the process."""
    world, failed, told = World(), threading.Event(), []

    class Failing(Publisher):
        def publish(self, step, spent_ns):
            raise OSError("the wire is cut")

    publisher = Failing(late=0)
    guard = LiveNode(world.live, CHANGES, None, publisher, Twists(), None)

    def tell(error):
        told.append((str(error), list(publisher.last_words)))
        failed.set()

    life = LiveNodeLifecycle(lambda ros: nullcontext(guard), list, tell)
    life.configure(None)
    life.activate()
    assert failed.wait(30.0)
    assert told == [("the wire is cut", ["inactive"])]
    life.deactivate()
    life.clean_up()
