"""Plans in the panel: the ghost of an approach, and the needle on its corridor."""

import numpy as np
import pytest

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
        replayed.plans.go_to(place)
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
