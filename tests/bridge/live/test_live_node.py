"""A live session that fails does not leave an active node that publishes nothing."""

import threading
from contextlib import nullcontext
from dataclasses import replace

import pytest

from app.bridge.heartbeat import steady_ns
from app.bridge.live.live_node import LiveNodeLifecycle
from app.bridge.live.outputs import TwistOutput
from app.runtime import LiveRun, PassiveOutput, StepTiming
from tests.doubles import PARAMETERS
from tests.session.test_live import SimulatedHost, track
from tests.session_content import one_link_content
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


class Failing(PassiveOutput):
    """Test double of a publisher that raises; counts the calls of `end`."""

    def __init__(self):
        self.ended = 0

    def publish(self, step, timing):
        raise OSError("connection lost")

    def end(self):
        self.ended += 1


def test_error_of_a_step_ends_the_outputs_and_is_passed_to_the_error_callback():
    host, failed, errors = SimulatedHost(), threading.Event(), []
    track(host, 0, 400)
    publisher = Failing()
    node = LiveRun(host.live, one_link_content(), (publisher,))

    def on_error(error):
        errors.append((str(error), publisher.ended))
        failed.set()

    managed = LiveNodeLifecycle(lambda ros: nullcontext(node), list, on_error)
    managed.configure(None)
    managed.activate()
    assert failed.wait(DEADLINE_S)
    assert errors == [("connection lost", 1)]
    managed.deactivate()
    managed.clean_up()


class Limiter:
    """Test double of a twist limiter: the calls that it received."""

    def __init__(self):
        self.calls = []

    def allow(self, step, stale_after_ns, spent_ns, since_ns):
        assert since_ns <= steady_ns()
        self.calls.append((step, stale_after_ns, spent_ns))

    def forbid(self):
        self.calls.append(None)


def test_twists_are_allowed_in_time_and_forbidden_late_revoked_and_at_the_end():
    limiter = Limiter()
    output = TwistOutput(limiter, PARAMETERS)
    assert output.publish("step", StepTiming(spent_ns=7))
    assert output.publish("late", StepTiming(in_time=False))
    output.revoke()
    output.end()
    assert limiter.calls == [("step", PARAMETERS, 7), None, None, None]


def test_twists_last_no_longer_than_the_margins_of_a_new_content_allow():
    limiter = Limiter()
    output = TwistOutput(limiter, PARAMETERS)
    content = one_link_content()
    shorter = content.margins.replaced(stale_after_ns=PARAMETERS.stale_after_ns // 2)
    output.prepare(content)(replace(content, margins=shorter))
    output.publish("step", StepTiming())
    assert limiter.calls == [("step", shorter, 0)]
