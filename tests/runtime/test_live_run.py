"""A step that came too late holds the session and revokes permissions until a re-arm."""

import pytest

from app.fixture import Reason
from app.runtime import LiveRun, PassiveOutput
from tests.session.test_live import World, track
from tests.session_content import one_link_content

CONTENT = one_link_content()


class Publisher(PassiveOutput):
    """Test double of a publisher for which step number ``late`` comes too late."""

    def __init__(self, late):
        self.late, self.count = late, 0
        self.ended = 0

    def publish(self, step, timing):
        assert timing.spent_ns == 0
        self.count += 1
        return self.count != self.late

    def end(self):
        self.ended += 1


class Permissions(PassiveOutput):
    """Test double of an output that permits motion: the permitted steps, None for a revocation."""

    def __init__(self):
        self.permitted = []
        self.spent_ns = []

    def publish(self, step, timing):
        self.permitted.append(step if timing.in_time else None)
        self.spent_ns.append(timing.spent_ns)
        return True

    def revoke(self):
        self.permitted.append(None)


def test_late_step_holds_what_follows_until_rearmed():
    world, permissions = World(), Permissions()
    track(world, 0, 400)
    world.at(300, world.rearm)
    world.at(390, world.live.stop)
    publisher = Publisher(late=8)
    run = LiveRun(world.live, CONTENT, (publisher, permissions))
    steps = list(run.steps())
    # Revoked at once, then told that the late step permits nothing, and revoked at the end.
    assert permissions.permitted == [*steps[:7], None, None, *steps[8:], None]
    assert publisher.ended == 1
    assert not any(step.decision.hold for step in steps[4:8])
    latched = [step.decision for step in steps[8:] if Reason.LATCHED in step.decision.reasons]
    assert latched == [step.decision for step in steps[8 : 8 + len(latched)]]
    assert len(latched) >= 5
    assert all(decision.hold and decision.constraint.hold for decision in latched)
    assert not steps[-1].decision.hold


def test_permission_does_not_last_longer_because_publishing_took_long():
    world, permissions = World(), Permissions()
    track(world, 0, 100)
    world.at(90, world.live.stop)

    class Slow(Publisher):
        def publish(self, step, timing):
            world.ns += 7
            return super().publish(step, timing)

    assert list(LiveRun(world.live, CONTENT, (Slow(late=0), permissions)).steps())
    assert set(permissions.spent_ns) == {7}


def test_error_revokes_permissions_ends_outputs_and_unlocks_the_session():
    world, permissions = World(), Permissions()
    track(world, 0, 400)

    class Failing(Publisher):
        def publish(self, step, timing):
            if self.count == 5:
                raise OSError("the wire is cut")
            return super().publish(step, timing)

        def end(self):
            super().end()
            raise OSError("the wire is still cut")

    publisher, last = Failing(late=0), Publisher(late=0)
    run = LiveRun(world.live, CONTENT, (publisher, permissions, last))
    with pytest.raises(OSError, match="still cut") as raised:
        list(run.steps())
    assert "the wire is cut" in str(raised.value.__context__)
    assert permissions.permitted[-1] is None
    assert (publisher.ended, last.ended) == (1, 1)
    with world.live.between_steps() as session:
        assert session is not None
