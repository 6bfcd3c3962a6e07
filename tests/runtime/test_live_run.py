"""A step that is published too late holds the session and revokes permissions until a re-arm."""

import pytest

from app.fixture import Reason
from app.runtime import LiveRun, PassiveOutput
from tests.session.test_live import SimulatedHost, track
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
    host, permissions = SimulatedHost(), Permissions()
    track(host, 0, 400)
    host.at(300, host.rearm)
    host.at(390, host.live.stop)
    publisher = Publisher(late=8)
    run = LiveRun(host.live, CONTENT, (publisher, permissions))
    steps = list(run.steps())
    # The late step revokes the permission and is then published as late; the end revokes it again.
    assert permissions.permitted == [*steps[:7], None, None, *steps[8:], None]
    assert publisher.ended == 1
    assert not any(step.decision.hold for step in steps[4:8])
    latched = [step.decision for step in steps[8:] if Reason.LATCHED in step.decision.reasons]
    assert latched == [step.decision for step in steps[8 : 8 + len(latched)]]
    assert len(latched) >= 5
    assert all(decision.hold and decision.constraint.hold for decision in latched)
    assert not steps[-1].decision.hold


def test_permission_does_not_last_longer_because_publishing_took_long():
    host, permissions = SimulatedHost(), Permissions()
    track(host, 0, 100)
    host.at(90, host.live.stop)

    class Slow(Publisher):
        def publish(self, step, timing):
            host.ns += 7
            return super().publish(step, timing)

    assert list(LiveRun(host.live, CONTENT, (Slow(late=0), permissions)).steps())
    assert set(permissions.spent_ns) == {7}


def test_error_revokes_permissions_ends_outputs_and_unlocks_the_session():
    host, permissions = SimulatedHost(), Permissions()
    track(host, 0, 400)

    class Failing(Publisher):
        def publish(self, step, timing):
            if self.count == 5:
                raise OSError("connection lost")
            return super().publish(step, timing)

        def end(self):
            super().end()
            raise OSError("connection still lost")

    publisher, last = Failing(late=0), Publisher(late=0)
    run = LiveRun(host.live, CONTENT, (publisher, permissions, last))
    with pytest.raises(OSError, match="still lost") as raised:
        list(run.steps())
    assert "connection lost" in str(raised.value.__context__)
    assert permissions.permitted[-1] is None
    assert (publisher.ended, last.ended) == (1, 1)
    with host.live.between_steps() as session:
        assert session is not None
