"""A live run keeps its hold, and begins with that of the run before it."""

import time
from dataclasses import replace

import numpy as np
import pytest

from app.fixture import Reason
from app.hold import InstanceKey, live_state
from app.runtime import HoldKeeper, LiveRun, used_values
from tests.session.test_live import SimulatedHost, track
from tests.session_content import one_link_content

CONTENT = one_link_content()
USED = used_values(CONTENT)
KEY = InstanceKey("host", 7, "/", "")


@pytest.fixture
def run(tmp_path):
    """``run(change)`` takes the steps of a session of 400 ms, whose start causes it returns."""

    def take(change=lambda host: None, expired=lambda: False, outputs=(), stop_ms=390):
        host = SimulatedHost()
        track(host, 0, 400)
        host.at(stop_ms, host.live.stop)
        change(host)
        with live_state(tmp_path / "state", KEY, USED, clock_ns=time.time_ns, log=print) as state:
            keeper = HoldKeeper(state, expired)
            return list(LiveRun(host.live, CONTENT, outputs, keeper).steps())

    return take


def first_cause(steps):
    causes = steps[0].hold_causes
    return causes[0] if causes else ""


def is_held(steps):
    """True if all steps are on hold; False if the last one is not."""
    holds = {step.decision.hold for step in steps[4:]}
    assert len(holds) == 1
    return holds.pop()


def test_orderly_end_without_hold_lets_the_next_run_begin_without(run):
    assert not is_held(run())
    steps = run()
    assert not is_held(steps)
    assert not any(cause.startswith("guard") for cause in steps[0].hold_causes)


def test_end_on_hold_holds_the_next_runs_until_a_rearm(run):
    run(lambda host: host.at(200, lambda: host.live.hold("the operator's reason")))
    for _ in range(2):
        steps = run()
        assert is_held(steps)
        assert Reason.LATCHED in steps[0].decision.reasons
        assert first_cause(steps).startswith("guard restarted: the last run")
        assert "the operator's reason" in steps[-1].hold_causes
    steps = run(lambda host: host.at(200, host.rearm))
    assert steps[5].decision.hold
    assert not steps[-1].decision.hold
    assert steps[-1].hold_causes == ()
    assert not is_held(run())


def test_hold_after_the_last_step_is_kept(run):
    run(lambda host: host.at(389.9, lambda: host.live.hold("at the last moment")))
    assert "at the last moment" in run()[0].hold_causes


def test_constraint_that_expired_after_the_last_step_is_a_hold(run):
    run(expired=lambda: True)
    assert is_held(run())


def test_error_of_an_output_or_of_the_reader_is_a_hold(run, tmp_path):
    class Failing:
        def publish(self, step, timing):
            raise OSError("connection lost")

        def revoke(self):
            pass

        def end(self):
            pass

    with pytest.raises(OSError, match="connection lost"):
        run(outputs=(Failing(),))
    steps = run()
    assert is_held(steps)
    assert "the session has failed: connection lost" in steps[0].hold_causes

    host = SimulatedHost()
    track(host, 0, 400)
    with live_state(tmp_path / "other", KEY, USED, clock_ns=time.time_ns, log=print) as state:
        steps = LiveRun(host.live, CONTENT, (), HoldKeeper(state, lambda: False)).steps()
        next(steps)
        steps.close()
    with live_state(tmp_path / "other", KEY, USED, clock_ns=time.time_ns, log=print) as state:
        assert "the session has failed: GeneratorExit" in state.start_causes


def test_values_that_the_last_run_did_not_use_begin_on_hold_until_a_rearm(tmp_path):
    """An accepted tip is not forgotten: the file's one needs an operator's consent."""

    def steps_of(change=lambda host, run: None):
        host = SimulatedHost()
        content = replace(CONTENT, robot=None, static_edges=host.setup.static_edges)
        track(host, 0, 400)
        host.at(390, host.live.stop)
        used = used_values(content)
        with live_state(tmp_path, KEY, used, clock_ns=time.time_ns, log=print) as state:
            run = LiveRun(host.live, content, (), HoldKeeper(state, lambda: False))
            change(host, run)
            return list(run.steps())

    def accept(tip):
        def at_its_time(host, run):
            host.at(100, lambda: run.commands.set_tip(tip, origin="a test"))
            host.at(200, host.rearm)

        return at_its_time

    file_tip = SimulatedHost().setup.tool_from_tip
    accepted = replace(file_tip, translation_mm=np.add(file_tip.translation_mm, (0.0, 0.0, 10.0)))
    assert not steps_of(accept(accepted))[-1].decision.hold
    for _ in range(2):  # also after a restart on hold
        steps = steps_of()
        assert is_held(steps)
        assert [cause for cause in steps[0].hold_causes if cause.startswith("not as in")] == [
            "not as in the last run: the tip is moved by 10.00 mm and turned by 0.00 degrees"
        ]
    assert not steps_of(lambda host, run: host.at(200, host.rearm))[-1].decision.hold
    assert not is_held(steps_of())


def test_other_values_are_named_before_the_causes_of_earlier_holds(tmp_path):
    earlier = tuple(f"cause {number}" for number in range(9))
    with live_state(tmp_path, KEY, USED, clock_ns=time.time_ns, log=print) as state:
        state.resume()
        state.end(True, earlier)
    changed = {**USED, "image_depth_mm": 40.0}
    with live_state(tmp_path, KEY, changed, clock_ns=time.time_ns, log=print) as state:
        restarted, change, *others = state.start_causes
    assert restarted.startswith("guard restarted")
    assert (
        change == "not as in the last run: the depth of the images is 40 mm instead of not stated"
    )
    assert others == list(earlier[: len(others)]) and others


def test_second_activation_of_one_run_is_kept_as_well(tmp_path):
    host = SimulatedHost()
    track(host, 0, 800)
    with live_state(tmp_path, KEY, USED, clock_ns=time.time_ns, log=print) as state:
        run = LiveRun(host.live, CONTENT, (), HoldKeeper(state, lambda: False))
        host.at(390, host.live.stop)
        assert list(run.steps())
        host.live.resume()
        host.live.hold("while active again")
        host.at(790, host.live.stop)
        assert list(run.steps())
    with live_state(tmp_path, KEY, USED, clock_ns=time.time_ns, log=print) as state:
        assert "while active again" in state.start_causes
