"""Plans in the panel: the ghost of an approach, and the needle on its corridor."""

import numpy as np
import pytest
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.fixture import MarginState
from app.geometry import InputError
from app.scene.convert import world_matrix
from tests.planning.plan_files import TURN_RAD, write_approach
from tests.shipped_case import middle_s
from tests.slicer_module.marginguard_module import (
    CASE,
    CLEAR_S,
    INVALID,
    node_of,
    show,
    spin_until,
    write_plans,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

STYLUS = "Planned_stylus_model"
FREE_S = 5.0
"""A moment at which the arm touches nothing."""


def test_plans_are_in_the_scene_until_the_session_ends(replayed, application, tmp_path):
    show(replayed, CLEAR_S)
    approach, needle = write_plans(tmp_path, replayed.session)
    replayed.plans.show_approach(approach)
    replayed.plans.show_needle(needle)
    plans = replayed.refresh().plans
    assert (plans.approach.problem, plans.approach.nearest) == ("", "20.0 mm from ball")
    assert (plans.needle.lateral, plans.needle.remaining) == ("5.0 mm", "20.0 mm")
    assert plans.needle.gate == "open"

    robot = replayed.session.started().content.robot
    base = world_matrix(replayed.session.display.frame_node(robot.base_frame))
    held = dict.fromkeys(robot.robot.actuated_joint_names[1:], 0.1)
    for place, turn in ((20, TURN_RAD), (0, 0.0)):
        replayed.plans.ghost.go_to(place)
        replayed.refresh()
        stylus = robot.robot.forward_kinematics({**held, "waist": turn})["stylus"]
        found = world_matrix(node_of(application, STYLUS).GetParentTransformNode())
        np.testing.assert_allclose(found, base @ stylus.matrix, atol=1e-9)
    assert node_of(application, "stylus_model") is not None  # the robot itself stays
    assert node_of(application, "Planned_Corridor") is not None

    status = show(replayed, middle_s(INVALID))
    assert status.state is MarginState.UNKNOWN
    assert status.plans.needle.problem.startswith("margin: is UNKNOWN (")
    assert status.plans.needle.tip is None

    replayed.end_session()
    assert node_of(application, STYLUS) is node_of(application, "Planned_Corridor") is None
    with pytest.raises(InputError, match="no such file; expected the JSON of a plan"):
        replayed.plans.show_approach(approach.parent)


def place_handle(node, shift_mm, scale=1.0):
    """Move the node by ``shift_mm`` in its parent's frame, as Slicer's handles do."""
    matrix = vtkMatrix4x4()
    node.GetMatrixTransformToParent(matrix)
    for axis, way_mm in enumerate(shift_mm):
        matrix.SetElement(axis, 3, matrix.GetElement(axis, 3) + way_mm)
        matrix.SetElement(axis, 0, matrix.GetElement(axis, 0) * scale)
    node.SetMatrixTransformToParent(matrix)


def test_arm_follows_the_handle_of_the_goal_or_says_why_not(replayed, application):
    show(replayed, FREE_S)
    goal = replayed.plans.goal
    assert replayed.refresh().plans.goal.is_active is False
    goal.begin(0.1)
    assert replayed.refresh().plans.goal.problem == ""
    handle, stylus = (node_of(application, name) for name in ("ToolGoal", STYLUS))
    begin = world_matrix(handle)
    assert handle.GetDisplayNode().GetEditorVisibility()
    np.testing.assert_allclose(world_matrix(stylus.GetParentTransformNode()), begin, atol=1e-6)

    place_handle(handle, (-5.0, -3.0, 2.0))
    assert replayed.refresh().plans.goal.problem == ""
    moved = world_matrix(handle)
    assert np.linalg.norm((moved - begin)[:3, 3]) == pytest.approx(np.sqrt(38.0), abs=1e-6)
    np.testing.assert_allclose(world_matrix(stylus.GetParentTransformNode()), moved, atol=1e-4)

    goal.plan()
    place_handle(handle, (0.0, 0.0, 1.0))  # the answer has come, but for the earlier place
    assert replayed.refresh().plans.goal.status == "cancelled: the goal has moved; plan again"
    moved = world_matrix(handle)

    place_handle(handle, (2000.0, 0.0, 0.0))
    shown = replayed.refresh().plans.goal
    assert shown.problem.startswith("out of reach: link 'stylus' cannot be moved to")
    assert shown.can_plan is False
    np.testing.assert_allclose(world_matrix(stylus.GetParentTransformNode()), moved, atol=1e-4)
    place_handle(handle, (-2000.0, 0.0, 0.0), scale=2.0)
    assert replayed.refresh().plans.goal == shown  # a goal is not scaled
    place_handle(handle, (-2000.0, 0.0, 0.0))
    back = replayed.refresh().plans.goal
    assert back.problem == ""

    other = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    place_handle(other, (10.0, 0.0, 0.0))
    handle.SetAndObserveTransformNodeID(other.GetID())
    place_handle(handle, (1.0, 0.0, 0.0))
    assert replayed.refresh().plans.goal == back
    np.testing.assert_allclose(world_matrix(handle), moved, atol=1e-6)  # below the robot's base
    application.scene.RemoveNode(other)

    application.scene.RemoveNode(handle)
    assert replayed.refresh().plans.goal.is_active is False
    assert node_of(application, STYLUS) is None
    goal.begin(5.0)
    replayed.refresh()
    assert node_of(application, "ToolGoal") is not None
    replayed.end_session()
    assert node_of(application, "ToolGoal") is node_of(application, STYLUS) is None


def test_widgets_set_a_goal_and_say_that_a_replay_plans_nothing(panel, opens_at_once, errors):
    ui, logic = panel.ui, panel.logic.panel_logic
    panel.refresh()
    assert ui.goalLabel.text() == "needs a robot whose base is registered"
    assert not ui.beginGoalButton.isEnabled()
    logic.load_case(CASE)
    spin_until(logic, lambda now: now.position_s is not None)
    show(logic, FREE_S)
    panel.refresh()
    assert not ui.planGoalButton.isEnabled()
    ui.goalClearanceSpinBox.setValue(0.1)
    ui.beginGoalButton.click()
    panel.refresh()
    assert " mm from the root of the robot" in ui.goalLabel.text()
    ui.planGoalButton.click()
    panel.refresh()
    assert "\napproach: the session is not live; expected a live one" in ui.goalLabel.text()
    ui.endGoalButton.click()
    panel.refresh()
    assert ui.goalLabel.text() == ""
    assert ui.beginGoalButton.isEnabled()
    assert errors == []


def test_widgets_show_plans_and_why_one_is_refused(panel, opens_at_once, errors, tmp_path):
    ui, logic = panel.ui, panel.logic.panel_logic
    logic.load_case(CASE)
    spin_until(logic, lambda now: now.position_s is not None)
    show(logic, CLEAR_S)
    approach, needle = write_plans(tmp_path, logic.session)
    ui.approachPathLineEdit.setText(str(approach))
    ui.showApproachButton.click()
    ui.needlePathLineEdit.setText(str(needle))
    ui.showNeedleButton.click()
    # The replay plays on until it is paused.
    wait_until(lambda: "gate OPEN" in ui.needleLabel.text(), panel.refresh)
    assert "lateral error 5.0 mm\nangle 0.0" in ui.needleLabel.text()
    assert not ui.crosshairLabel.pixmap().isNull()
    assert ui.approachSlider.property("value") == ui.approachSlider.property("maximum") == 20.0
    ui.approachSlider.setValue(0.0)
    assert "\n0.00 of 0.90 s: 30.0 mm from ball; at least 5 mm" in ui.approachLabel.text()
    ui.corridorComboBox.setCurrentIndex(1)
    ui.useCorridorButton.click()
    panel.refresh()
    assert ui.needleLabel.text().startswith("corridor 2: 50 mm deep\n")

    robot = logic.session.started().content.robot.robot
    write_approach(approach, robot, "other")
    ui.showApproachButton.click()
    panel.refresh()
    assert "plan: is of the setup 'other'; expected " in ui.approachLabel.text()
    assert not ui.approachSlider.isEnabled()
    approach.write_text("[]")
    ui.showApproachButton.click()
    assert [each for each in errors if "is not a plan" in each]
    ui.removeApproachButton.click()
    ui.removeNeedleButton.click()
    panel.refresh()
    assert ui.approachLabel.text() == ui.needleLabel.text() == "no plan"
    assert ui.crosshairLabel.pixmap().isNull()
