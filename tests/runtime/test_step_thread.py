"""A step thread delivers the newest step and ages it after its run."""

import threading
from types import SimpleNamespace

import pytest

from app.fixture import MarginState
from app.geometry import MarginGuardError
from app.hold import SeenHold
from app.runtime import StepThread
from tests.manual_clock import ManualClock

DEADLINE_S = 60.0
STAMP_NS = 5_000
NEGATIVE, UNKNOWN = MarginState.NEGATIVE, MarginState.UNKNOWN


class RunDouble:
    """Test double of a run: yields ``steps`` and then waits for `stop`, or raises ``error``."""

    delay_ns = 0

    def __init__(self, *steps, pace=1.0, error=None, operator=None):
        self.operator = operator
        self._steps, self._pace, self._error = steps, pace, error
        self._stopped = threading.Event()

    def steps(self):
        yield from self._steps
        if self._error is not None:
            raise self._error
        self._stopped.wait()

    def stop(self):
        self._stopped.set()

    def pace(self):
        return self._pace


def step_double(seq=1, state=NEGATIVE, hold=False, stamp_ns=STAMP_NS):
    """Test double of a step: the values that a step thread reads."""
    return SimpleNamespace(
        decision=SimpleNamespace(seq=seq, state=state, hold=hold),
        frame=SimpleNamespace(stamp=SimpleNamespace(ns=stamp_ns)),
    )


@pytest.fixture
def clock():
    return ManualClock(100)


@pytest.fixture
def start(clock):
    """``start(run)`` starts a thread that is stopped after the test."""
    threads = []

    def start(run, **options):
        threads.append(StepThread(run, clock, **options))
        return threads[-1]

    yield start
    for thread in threads:
        thread.stop()


def test_step_is_delivered_once_with_time_of_its_arrival(start, clock):
    step = step_double()
    thread = start(RunDouble(step))
    delivered = thread.newest(DEADLINE_S)
    assert delivered.step is step
    assert delivered.thread is thread
    assert delivered.at_ns == clock.ns
    assert thread.newest(0.0) is None


def test_step_is_delivered_with_content_of_its_time(start):
    before, after = object(), object()
    commands = SimpleNamespace(content=before, seen=lambda: None)
    delivered = start(RunDouble(step_double(), operator=commands)).newest(DEADLINE_S)
    commands.content = after
    assert delivered.content is before


def test_step_of_run_without_commands_has_no_content(start):
    assert start(RunDouble(step_double())).newest(DEADLINE_S).content is None


def test_only_newest_of_several_steps_is_delivered(start):
    thread = start(RunDouble(*(step_double(seq) for seq in range(1, 6))))
    thread.stop()
    assert thread.newest(0.0).step.decision.seq == 5
    assert thread.newest(0.0) is None


def test_stop_ends_thread_without_failure(start):
    thread = start(RunDouble())
    assert not thread.is_over
    thread.stop()
    assert thread.is_over
    assert thread.failure == ""


def test_error_of_run_is_described_and_keeps_last_step(start):
    step = step_double()
    run = RunDouble(step, error=ValueError("broken\ninside"))
    thread = start(run, describe=lambda error: f"{type(error).__name__} of the run")
    thread.stop()
    assert thread.is_over
    assert thread.failure == "ValueError of the run"
    assert thread.newest(0.0).step is step


def test_error_is_described_by_its_text_unless_stated_otherwise(start):
    thread = start(RunDouble(error=OSError("the wire is cut")))
    thread.stop()
    assert thread.failure == "the wire is cut"


@pytest.mark.parametrize(("pace", "elapsed_ns"), [(1.0, 40), (0.5, 20), (0.0, 0)])
def test_present_advances_with_pace_while_running(start, clock, pace, elapsed_ns):
    thread = start(RunDouble(step_double(), pace=pace))
    delivered = thread.newest(DEADLINE_S)
    assert thread.present_ns(delivered) == STAMP_NS
    clock.ns += 40
    assert not thread.is_over
    assert thread.present_ns(delivered) == STAMP_NS + elapsed_ns


@pytest.mark.parametrize("error", [None, ValueError("broken")])
def test_present_advances_with_clock_after_paused_run_is_over(start, clock, error):
    thread = start(RunDouble(step_double(), pace=0.0, error=error))
    delivered = thread.newest(DEADLINE_S)
    thread.stop()
    clock.ns += 40
    assert thread.present_ns(delivered) == STAMP_NS + 40


def test_step_of_replaced_run_ages_although_new_run_is_paused(start, clock):
    before = start(RunDouble(step_double(), pace=0.0))
    delivered = before.newest(DEADLINE_S)
    before.stop()
    replacement = start(RunDouble(pace=0.0))
    clock.ns += 40
    assert not replacement.is_over
    assert replacement.present_ns(delivered) == STAMP_NS + 40


def test_step_is_delivered_with_the_hold_of_its_time(start):
    commands = SimpleNamespace(content=None, seen=lambda: SeenHold(7, 9))
    delivered = start(RunDouble(step_double(), operator=commands)).newest(DEADLINE_S)
    assert delivered.seen == SeenHold(7, 9)
    assert start(RunDouble(step_double())).newest(DEADLINE_S).seen is None


def test_run_that_does_not_end_is_an_error(clock, monkeypatch):
    monkeypatch.setattr("app.runtime.step_thread._JOIN_S", 0.01)
    run = RunDouble()
    thread = StepThread(run, clock)
    monkeypatch.setattr(run, "stop", lambda: None)
    with pytest.raises(MarginGuardError, match=r"has not ended after 0\.01 s"):
        thread.stop()
    assert not thread.is_over
    assert "has not ended" in thread.failure
    monkeypatch.undo()
    thread.stop()
    assert thread.is_over
