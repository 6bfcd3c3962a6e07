"""Guided registration of the robot: points from dwells, residuals, removal, acceptance, undo."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import FrameError, InputError, TrackedTransform, TrackingStatus, Transform
from app.runtime import ShownItem
from app.session import Session
from app.workflow import Phase, RobotRegistration, fit_registration
from app.workflow.robot_registration import RobotSamples
from tests.session_content import one_link_content
from tests.workflow.guided import Guided

pytestmark = pytest.mark.slow

FRAMES = 380
"""Up to the end of the last of 8 dwells of the shipped case."""


@pytest.fixture(scope="module")
def content(recorded_case):
    return recorded_case.content


@pytest.fixture(scope="module")
def steps(recorded_case):
    session = Session(recorded_case.setup)
    return [session.step(frame) for frame in islice(recorded_case.case.frames(), FRAMES)]


def with_registration(content, command):
    return replace(content, robot=replace(content.robot, registration=command.registration))


class GuidedRobot(Guided):
    """A registration with the steps of the case."""

    def __init__(self, content):
        super().__init__(RobotRegistration, content, fit_registration, with_registration)

    def begin(self, steps, *tool):
        self.guide.start(self.seen, *tool)
        for step in steps:
            self.guide.observe(step)

    def record(self, steps, *tool):
        self.begin(steps, *tool)
        return self.stop()


@pytest.fixture
def guided(content):
    return GuidedRobot(content)


def test_touched_points_register_as_the_command_does(guided, steps, recorded_case):
    before = guided.content.registration
    fit = guided.record(steps)
    assert [each.problem for each in fit.points] == [""] * 8
    assert fit.accepted
    known = recorded_case.setup.robot.registration  # by the intervals that the case names
    assert fit.result.transform.distance_mm_to(known.transform) < 0.2
    assert np.degrees(fit.result.transform.angle_to(known.transform)) < 0.1
    errors = [each.residual_mm for each in fit.points]
    np.testing.assert_allclose(errors, fit.result.residuals_mm)
    assert all(each.leave_one_out_mm >= each.residual_mm for each in fit.points)
    guided.accept()
    assert guided.content.registration is fit.result
    assert guided.guide.status().phase is Phase.IDLE
    guided.undo()
    assert guided.content.registration is before
    assert not guided.guide.can_undo


def test_removed_point_is_not_used_and_is_restored(guided, steps):
    fit = guided.record(steps)
    first = fit.points[0].interval
    guided.guide.remove(guided.seen, first[0])
    with pytest.raises(InputError, match="it is being computed"):
        guided.accept()
    less = guided.fit()
    assert [each.interval for each in less.points] == [each.interval for each in fit.points[1:]]
    assert len(less.result.residuals_mm) == 7
    with pytest.raises(InputError, match="that point does not exist"):
        guided.guide.remove(guided.seen, first[0])
    guided.guide.restore(guided.seen)
    assert guided.fit().points == fit.points
    with pytest.raises(InputError, match="no point was removed"):
        guided.guide.restore(guided.seen)


def test_place_of_a_removed_point_may_be_touched_again(guided, steps):
    """The same samples, some later: as a second touch of each landmark."""
    guided.begin(steps[:70])
    once = guided.fit()
    assert len(once.points) == 2
    task = guided.guide.task() or guided.guide._samples.task(
        once.run, guided.content, guided.content.robot, ()
    )
    later = [each + 60_000_000_000 for each in task.times_ns]
    arrays = {
        name: np.concatenate([getattr(task, name)] * 2)
        for name in (
            "tool_rotations", "tool_translations_mm", "link_rotations", "link_translations_mm"
        )
    }  # fmt: skip
    twice = replace(task, times_ns=(*task.times_ns, *later), **arrays)
    assert len(fit_registration(twice).points) == 2
    again = fit_registration(replace(twice, excluded=(once.points[0].interval,)))
    assert len(again.points) == 2
    assert again.points[-1].interval[0] > task.times_ns[-1]


def test_few_points_and_no_points_are_refused_with_the_reason(guided, steps):
    fit = guided.record(steps[:30])
    assert (len(fit.points), fit.result) == (1, None)
    assert fit.reason == "1 points; expected at least 4"
    with pytest.raises(InputError, match="registration: 1 points; expected at least 4"):
        guided.accept()
    guided.guide.discard(guided.seen)
    guided.guide.start(guided.seen)
    guided.guide.stop(guided.seen)
    with pytest.raises(InputError, match="nothing was recorded"):
        guided.accept()
    with pytest.raises(InputError, match="nothing is recorded"):
        guided.guide.stop(guided.seen)


def test_step_without_joints_is_not_recorded_and_says_why(guided, steps):
    guided.guide.start(guided.seen)
    guided.guide.observe(replace(steps[0], edges=steps[20].edges._replace(links={})))
    status = guided.guide.status()
    assert status.samples == 0
    assert "is not known now" in status.problem
    guided.guide.observe(steps[25])
    guided.guide.observe(steps[20])
    assert "clock went back" in guided.guide.status().problem
    assert guided.guide.status().samples == 1


def test_recording_is_bounded(content, steps, monkeypatch):
    monkeypatch.setattr("app.workflow.robot_registration.MAX_SAMPLES", 5)
    samples = RobotSamples()
    for step in steps[20:30]:
        samples.observe(step, content, content.robot)
    assert len(samples) == 5
    assert samples.problem == "5 samples are recorded, and no more are: stop"


def test_step_does_not_wait_while_the_samples_of_a_task_are_converted(guided, steps, monkeypatch):
    """30,000 samples take 0.1 s, and a step that observes would wait for them."""
    guided.begin(steps[:30])
    convert, began, observed = RobotSamples.task, threading.Event(), threading.Event()

    def slow(*args):
        began.set()
        assert observed.wait(30.0)
        return convert(*args)

    monkeypatch.setattr(RobotSamples, "task", slow)
    with ThreadPoolExecutor(1) as other:
        task = other.submit(guided.guide.task)
        assert began.wait(30.0)
        guided.guide.observe(steps[31])
        observed.set()
        assert len(task.result().times_ns) < guided.guide.status().samples


def test_change_of_another_page_is_refused_and_loses_nothing(guided, steps):
    fit = guided.record(steps)
    old = guided.seen - 1
    for change in (
        lambda: guided.guide.start(old),
        lambda: guided.guide.remove(old, fit.points[0].interval[0]),
        lambda: guided.guide.restore(old),
    ):
        with pytest.raises(InputError, match="another page has changed it meanwhile"):
            change()
    assert guided.guide.status().can_accept


def test_session_without_a_robot_has_none():
    with pytest.raises(InputError, match="the session has no robot"):
        GuidedRobot(replace(one_link_content(), robot=None))


def test_steps_without_a_tracked_tool_raise_no_error(guided, steps):
    guided.guide.start(guided.seen)
    guided.guide.observe(replace(steps[20], edges=steps[20].edges._replace(measured={})))
    assert guided.guide.status().problem
    with pytest.raises(FrameError):
        steps[20].edges._replace(measured={}).between("reference", "cautery")


POINTER = ShownItem("stylus", "pointer")
STYLUS_TIP = Transform(
    "pointer",
    "pointer_tip",
    Rotation.from_rotvec([0.4, -0.2, 0.1]).as_matrix(),
    [12.0, -7.0, 163.0],
)


def touched_by_stylus(step, content):
    """``step`` with a stylus whose tip is where that of the tracked tool is, and its sensor not."""
    measured = dict(step.edges.measured)
    try:
        tool, stamp = step.edges.between("reference", content.tool_from_tip.target)
    except FrameError:
        return step
    pose = tool @ content.tool_from_tip @ STYLUS_TIP.inverse().renamed(target="cautery_tip")
    measured["reference", "pointer"] = TrackedTransform(pose, stamp, TrackingStatus.OK)
    return replace(step, edges=step.edges._replace(measured=measured))


def test_landmarks_touched_with_the_stylus_give_the_residuals_of_the_cautery(
    guided, steps, content
):
    by_cautery = guided.record(steps)
    stylus = POINTER.with_tip(STYLUS_TIP, 0.3)
    other = GuidedRobot(replace(content, items=(stylus,) if stylus else ()))
    touched = (touched_by_stylus(step, content) for step in steps)
    by_stylus = other.record(touched, "stylus")
    assert other.guide.status().tool == "stylus"
    assert len(by_stylus.points) == len(by_cautery.points) == 8
    assert by_stylus.accepted
    for mine, known in zip(by_stylus.points, by_cautery.points, strict=True):
        assert mine.interval == known.interval
        # The mean of a dwell averages rotation and place of the sensor, which is elsewhere.
        assert mine.residual_mm == pytest.approx(known.residual_mm, abs=0.02)
    assert by_stylus.result.transform.distance_mm_to(by_cautery.result.transform) < 0.05


def test_a_stylus_without_a_tip_touches_nothing(content):
    for stylus, problem in (
        (None, "stylus: the session has none; expected 'stylus' in live.yaml"),
        (
            ShownItem("stylus", "pointer"),
            "stylus: it is not calibrated; expected a pivot calibration before",
        ),
    ):
        guided = GuidedRobot(replace(content, items=(stylus,) if stylus else ()))
        with pytest.raises(InputError, match=f"^{problem}$"):
            guided.guide.start(guided.seen, "stylus")
        assert guided.guide.status().phase is Phase.IDLE


def test_advice_for_the_stylus_names_both_tips(content, steps):
    guided = GuidedRobot(replace(content, items=(POINTER.with_tip(STYLUS_TIP, 0.3),)))
    guided.guide.start(guided.seen, "stylus")
    guided.guide.observe(steps[20])
    assert "'pointer' is not connected" in guided.guide.status().problem
    for step in steps[20:30]:
        guided.guide.observe(touched_by_stylus(step, content))
    assert guided.fit().advice.startswith("hold robot and stylus, tip on tip, still for 1 s")
