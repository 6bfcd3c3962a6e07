"""The steps of a case: what each has, and why it is not done."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import Transform
from app.registration import given_registration
from app.runtime import RecordingStatus
from app.session import Session, SessionSetup
from app.workflow import CalibrationKind, WorkflowName, WorkflowState, next_step, workflow_steps
from tests.doubles import PARAMETERS, AnalyticSphere, frame, sample
from tests.session_content import one_link_content
from tests.workflow.test_tool_calibration import GuidedTool

WITH_ROBOT = one_link_content()
TOOL, TUMOR, _ = WITH_ROBOT.static_edges
CONTENT = replace(WITH_ROBOT, robot=None, static_edges=(TOOL, TUMOR))
FINISHED = RecordingStatus(Path("/cases/first"), active=False, duration_s=12.0, messages=9)


def stepped(*, lost=False):
    """The second step of a session with a tool 50 mm away; ``lost``: without the needle."""
    session = Session(SessionSetup(TOOL, TUMOR, AnalyticSphere(10.0), PARAMETERS, None))
    for at_ms in (0, 20):
        poses = [sample("tracker", "cautery", (60.0, 0.001 * at_ms, -120.0), at_ms)]
        if not lost:
            poses.append(sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms))
        result = session.step(frame(at_ms, *poses))
    return result


def steps_of(step, content=CONTENT, *, is_live=True, **others):
    steps = workflow_steps(step, content, is_live=is_live, **others)
    assert [each.name for each in steps] == list(WorkflowName)
    return {each.name.value: each for each in steps}


def test_case_with_all_it_needs_is_done():
    steps = steps_of(stepped(), recording=FINISHED)
    states = [each.state for each in steps.values()]
    done, absent = WorkflowState.DONE, WorkflowState.ABSENT
    assert states == [done, done, done, absent, done, done]
    assert next_step(tuple(steps.values())) is None
    assert steps["connect"].has == "2 of 2 tracked frames"
    assert steps["navigate"].has == MarginState.NEGATIVE.display.label
    assert steps["review"].line == "\u2713 review: first, 12 s"
    assert steps["register"].line == "- register: no robot"


def test_lost_frame_is_named_and_comes_first():
    steps = steps_of(stepped(lost=True))
    assert steps["connect"].needs == "poses of cautery, needle"
    assert steps["connect"].problem == "no usable pose of needle now"
    assert steps["navigate"].has == "UNKNOWN"
    assert steps["navigate"].problem
    assert next_step(tuple(steps.values())) is steps["connect"]


@pytest.mark.parametrize("silent", ["", "the session has ended"])
def test_step_that_is_missing_or_outdated_is_not_done(silent):
    steps = steps_of(stepped() if silent else None, silent=silent)
    assert steps["connect"].problem == (silent or "no step has come yet")
    assert steps["navigate"].problem == (silent or "no step yet")


def test_tip_at_the_origin_and_unused_calibrations_are_not_done():
    unknown = Transform.identity("cautery", "cautery_tip")
    steps = steps_of(stepped(), replace(CONTENT, static_edges=(unknown, TUMOR)))
    assert "at the sensor's origin" in steps["calibrate"].problem
    guide = GuidedTool(CONTENT).guide
    guide.start(0, CalibrationKind.PIVOT)
    steps = steps_of(stepped(), calibration=guide.status())
    assert steps["calibrate"].problem == "a pivot of the cautery is being recorded"
    guide.stop(1)
    steps = steps_of(stepped(), calibration=guide.status())
    assert steps["calibrate"].problem == "a pivot of the cautery: its result is not used yet"
    guide.discard(2)
    done = steps_of(stepped(), replace(CONTENT, tip_sigma_mm=0.2), calibration=guide.status())
    assert done["calibrate"].has == "tip 120.0 mm from the sensor, sigma 0.20 mm"
    assert done["calibrate"].state is WorkflowState.DONE


def test_tumour_of_the_configuration_is_no_contour_where_images_come():
    assert steps_of(stepped())["contour"].has.endswith(", given with the case")
    given = steps_of(stepped(), has_images=True)["contour"]
    assert given.problem == "no contour was accepted in this session"
    replayed = steps_of(stepped(), has_images=True, is_live=False)["contour"]
    assert replayed.state is WorkflowState.DONE
    accepted = steps_of(stepped(), replace(CONTENT, tumor_accepted=True), has_images=True)
    assert accepted["contour"].state is WorkflowState.DONE
    assert accepted["contour"].has.endswith(", accepted in this session")


def test_robot_needs_an_accepted_registration():
    known = steps_of(stepped(), WITH_ROBOT)
    assert known["connect"].problem == "no usable pose of reference now"
    assert known["register"].state is WorkflowState.DONE
    assert known["register"].needs == "an accepted registration of robot_base"
    refused = replace(
        given_registration(Transform("reference", "robot_base", np.eye(3), [1.0, 2.0, 3.0])),
        accepted=False,
        reason="too uncertain",
    )
    for registration, problem in ((None, "not registered"), (refused, "too uncertain")):
        robot = replace(WITH_ROBOT.robot, registration=registration)
        steps = steps_of(stepped(), replace(WITH_ROBOT, robot=robot))
        assert problem in steps["register"].problem


def test_hold_is_named_with_its_causes():
    step = replace(stepped(), hold_causes=("tumour replaced",))
    held = replace(step, decision=step.decision._replace(hold=True))
    problem = steps_of(held)["navigate"].problem
    assert problem == "on hold until re-armed: tumour replaced"


def test_review_needs_a_finished_recording():
    assert steps_of(stepped())["review"].problem == "nothing is recorded"
    running = replace(FINISHED, active=True)
    assert steps_of(stepped(), recording=running)["review"].problem == "it is being recorded"
    failed = replace(FINISHED, problem="the disk is full")
    assert steps_of(stepped(), recording=failed)["review"].problem == "the disk is full"
    assert steps_of(stepped(), is_live=False)["review"].state is WorkflowState.DONE
