"""A replay plays the selected part of a recording, and publishes each step to its outputs."""

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from app.geometry import InputError
from app.runtime import PassiveOutput, PreparedCase, ReplayRun, SetMargins
from app.runtime.replay_run import RobotProblems
from app.session import SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere, frame, sample
from tests.session_content import one_link_content

CONTENT = one_link_content()
TIMES_MS = tuple(range(1000, 1200, 20))
"""Stamps of the recording; its first frame is not at 0."""


class CaseDouble:
    """Test double of a recorded case: a needle and a cautery tip that approaches it."""

    recording_path = Path("tracking.mcap")

    def __init__(self, times_ms=TIMES_MS):
        self._times_ms = times_ms

    def frames(self):
        for number, at_ms in enumerate(self._times_ms):
            yield frame(
                at_ms,
                sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms),
                sample("tracker", "cautery", (100.0 - number, 0.0, 0.001 * at_ms), at_ms),
            )


class Recorder(PassiveOutput):
    """Test double of an output that appends each call to ``calls``."""

    def __init__(self, name, calls):
        self.name, self.calls = name, calls
        self.timings = []

    def publish(self, step, timing):
        self.calls.append((self.name, step.index))
        self.timings.append(timing)
        return True

    def prepare(self, content):
        self.calls.append((self.name, "prepare"))
        return lambda content: self.calls.append((self.name, "switch"))

    def revoke(self):
        self.calls.append((self.name, "revoke"))

    def end(self):
        self.calls.append((self.name, "end"))


def prepared_case(case=None, robot=None):
    tool_edge, tumor_edge, _ = CONTENT.static_edges
    setup = SessionSetup(tool_edge, tumor_edge, AnalyticSphere(10.0), PARAMETERS, robot)
    return PreparedCase(case or CaseDouble(), setup, CONTENT, clock=None, tip_only=False)


def replay(prepared=None, **options):
    return ReplayRun(prepared or prepared_case(), clock_ns=lambda: 0, **options)


def times_ms(run):
    return [step.frame.stamp.ns // 1_000_000 for step in run.steps()]


def test_outputs_receive_each_step_once_in_their_order():
    calls = []
    first, second = Recorder("first", calls), Recorder("second", calls)
    steps = list(replay(outputs=(first, second)).steps())
    assert [step.index for step in steps] == list(range(len(TIMES_MS)))
    stepped = [(name, step.index) for step in steps for name in ("first", "second")]
    ended = [(name, call) for call in ("revoke", "end") for name in ("second", "first")]
    assert calls == [*stepped, *ended]


def test_outputs_end_once_also_after_a_stop_and_after_an_error_of_the_reader():
    for leave in (lambda run, steps: run.stop(), lambda run, steps: steps.close()):
        calls = []
        run = replay(outputs=(Recorder("output", calls),))
        steps = run.steps()
        next(steps)
        leave(run, steps)
        assert list(steps) == []
        assert calls[-2:] == [("output", "revoke"), ("output", "end")]
        assert calls.count(("output", "end")) == 1


def test_error_of_an_output_ends_all_outputs():
    calls = []

    class Failing(PassiveOutput):
        def publish(self, step, timing):
            raise OSError("connection lost")

    run = replay(outputs=(Recorder("output", calls), Failing()))
    with pytest.raises(OSError, match="connection lost"):
        list(run.steps())
    assert calls == [("output", 0), ("output", "revoke"), ("output", "end")]


def test_step_is_published_before_it_is_yielded():
    calls = []
    for step in replay(outputs=(Recorder("output", calls),)).steps():
        assert calls[-1] == ("output", step.index)


@pytest.mark.parametrize(
    ("part", "expected_ms"),
    [
        ({}, TIMES_MS),
        ({"end_s": 0.1}, (1000, 1020, 1040, 1060, 1080, 1100)),
        ({"end_s": 0.099}, (1000, 1020, 1040, 1060, 1080)),
        ({"end_s": 0.0}, (1000,)),
        ({"start_s": 0.06}, TIMES_MS[3:]),
        ({"start_s": 0.061}, TIMES_MS[4:]),
        ({"start_s": 0.06, "end_s": 0.1}, (1060, 1080, 1100)),
        ({"start_s": 0.1, "end_s": 0.06}, ()),
    ],
)
def test_start_and_end_select_part_of_recording(part, expected_ms):
    assert times_ms(replay(**part)) == list(expected_ms)


def test_end_of_empty_recording_is_refused():
    with pytest.raises(InputError, match=r"tracking\.mcap: 0 frames; expected 1 or more"):
        replay(prepared_case(CaseDouble(())), end_s=1.0)


def test_duration_of_each_step_is_measured_by_stopwatch():
    ticks = iter(range(0, 10_000, 7))
    output = Recorder("output", [])
    list(replay(stopwatch_ns=lambda: next(ticks), outputs=(output,)).steps())
    assert {(timing.duration_ns, timing.spent_ns) for timing in output.timings} == {(7, 0)}
    assert all(timing.in_time for timing in output.timings)


def test_paused_replay_takes_first_step_only():
    run = replay(paused=True)
    steps = run.steps()
    assert next(steps).frame.stamp.ns == 1_000_000_000
    assert run.pace() == 0.0
    run.stop()
    assert list(steps) == []


@pytest.mark.parametrize(("rate", "pace"), [(None, 1.0), (0.25, 0.25), (1.0, 1.0), (4.0, 1.0)])
def test_pace_is_rate_limited_to_real_time(rate, pace):
    assert replay(rate=rate).pace() == pace


def test_new_rate_changes_pace_and_invalid_rate_does_not():
    run = replay(rate=1.0)
    run.set_rate(0.5)
    with pytest.raises(InputError, match="rate"):
        run.set_rate(-1.0)
    assert run.pace() == 0.5


def test_setup_and_content_of_operator_replace_those_of_case():
    margins = PARAMETERS.replaced(stop_mm=2.0, warn_mm=6.0)
    prepared = prepared_case()
    changed = replace(CONTENT, margins=margins)
    run = replay(prepared, setup=replace(prepared.setup, margins=margins), content=changed)
    assert run.commands.content is changed
    assert run.commands.setup.margins == margins
    assert prepared.content.margins == PARAMETERS


def test_margins_change_content_and_setup():
    run = replay()
    run.operator.request(SetMargins(2.0, 6.0))
    for margins in (run.commands.content.margins, run.commands.setup.margins):
        assert (margins.stop_mm, margins.warn_mm) == (2.0, 6.0)
    assert (CONTENT.margins.stop_mm, CONTENT.margins.warn_mm) == (1.0, 5.0)
    assert len(list(run.steps())) == len(TIMES_MS)


def test_command_waits_until_step_is_taken():
    calls = []
    run = replay(outputs=(Recorder("output", calls),))
    steps = run.steps()
    next(steps)
    started = threading.Event()

    def change():
        started.set()
        run.operator.request(SetMargins(2.0, 6.0))

    thread = threading.Thread(target=change)
    thread.start()
    started.wait()
    assert calls == [("output", 0)]  # the lock is held until the next step is requested
    steps.close()
    thread.join()
    # The end of the steps may come between the preparation and the change, but not into the change.
    switched = calls.index(("output", "switch"))
    assert calls[switched - 1] == ("output", "revoke")
    assert ("output", "prepare") in calls[: switched - 1]


def test_robot_problem_is_counted_in_each_frame():
    run = replay(prepared_case(robot=CONTENT.robot))
    steps = list(run.steps())
    problems = [step.robot_problem for step in steps if step.robot_problem]
    assert problems, "expected a problem, because the recording has no joints"
    assert sum(count for _, count in run.robot_problems.items()) == len(problems)


def test_robot_problems_are_counted_by_kind_with_first_message():
    step = next(replay().steps())
    problems = RobotProblems()
    for text in ("joint limit: 1.5 rad", "", "no joints", "joint limit: 1.6 rad"):
        problems.add(replace(step, robot_problem=text))
    assert list(problems.items()) == [("joint limit: 1.5 rad", 2), ("no joints", 1)]
