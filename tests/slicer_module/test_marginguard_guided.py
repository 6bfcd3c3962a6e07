"""Guided calibration and registration by touch in the panel, with the engine of the page."""

from dataclasses import replace

import numpy as np
import pytest

from app.case import open_case
from app.geometry import InputError
from app.runtime import CalibrationKind, TrackedTool
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import CASE, cut_case, node_of, spin_until
from tests.viewer.calibrated_tool import (
    KNOWN_MM,
    SHAFT,
    STYLUS_TIP_MM,
    TIP_MM,
    move,
    write_session,
)

DWELLS = 8
DWELLS_END_S = 19.0


@pytest.fixture
def panel_logic(unconnected):
    return unconnected


def tip(panel_logic):
    return panel_logic.session.commands().content.tool_from_tip


def test_tool_is_calibrated_by_pivot_and_spin_and_undone(panel_logic, start, tmp_path, domain_id):
    motion = tmp_path / "motion"
    move(motion, "narrow")
    panel_logic.connect(write_session(tmp_path / "session"))
    spin_until(panel_logic, lambda now: now.calibration.can_start)
    with pytest.raises(InputError, match="no robot"):
        panel_logic.touch()
    panel_logic.calibration().start(CalibrationKind.PIVOT)
    tracker = start("-m", "tests.viewer.calibrated_tool", str(motion))
    status = spin_until(panel_logic, lambda now: "Not yet: the poses of a" in now.calibration.text)
    assert "tilt the tool slowly" in status.calibration.text
    assert status.calibration.is_recording and not status.calibration.can_use
    assert "a pivot of the cautery is being recorded" in status.workflow

    move(motion, "pivot")
    is_covered = lambda now: "8 of 8" in now.calibration.text and "Good" in now.calibration.text  # noqa: E731
    status = spin_until(panel_logic, is_covered)
    assert status.calibration.coverage.sectors == (True,) * 8
    assert "mm RMS" in status.calibration.text
    panel_logic.calibration().stop()
    spin_until(panel_logic, lambda now: now.calibration.can_use)
    np.testing.assert_allclose(tip(panel_logic).translation_mm, KNOWN_MM, atol=1e-9)
    panel_logic.calibration().use()
    status = spin_until(panel_logic, lambda now: now.calibration.can_undo)
    assert status.calibration.text == ""
    pivoted = tip(panel_logic)
    assert np.linalg.norm(pivoted.translation_mm - TIP_MM) < 0.5
    status = spin_until(panel_logic, lambda now: "hold: calibration of the tool" in now.reasons)
    assert "set_tip from the panel accepted" in status.request

    move(motion, "spin")
    tracker.line(lambda line: line.strip() == "spin")
    panel_logic.calibration().start(CalibrationKind.SPIN)
    spin_until(panel_logic, is_covered)
    panel_logic.calibration().stop()
    spin_until(panel_logic, lambda now: now.calibration.can_use)
    panel_logic.calibration().use()
    spin_until(panel_logic, lambda now: tip(panel_logic).angle_to(pivoted) > 0.0)
    assert np.degrees(np.arccos(tip(panel_logic).rotation[:, 2] @ SHAFT)) < 0.5
    spin_until(panel_logic, lambda now: now.calibration.can_undo)
    panel_logic.calibration().undo()
    spin_until(panel_logic, lambda now: tip(panel_logic).angle_to(pivoted) == 0.0)


def test_stylus_is_calibrated_beside_the_tool(panel_logic, application, start, tmp_path, domain_id):
    motion = tmp_path / "motion"
    move(motion, "pivot")
    panel_logic.connect(write_session(tmp_path / "session", stylus=True))
    start("-m", "tests.viewer.calibrated_tool", str(motion))
    status = spin_until(panel_logic, lambda now: now.calibration.can_start and now.contour.can_edit)
    assert status.stylus == "not calibrated"
    before = tip(panel_logic)
    stylus = TrackedTool.STYLUS
    with pytest.raises(InputError, match=r"^stylus: it is not calibrated; expected a pivot"):
        panel_logic.contour.add_tip(stylus)
    with pytest.raises(InputError, match=r"^spin: the tip of 'pointer' is at the sensor's origin"):
        panel_logic.calibration().start(CalibrationKind.SPIN, stylus)
    panel_logic.calibration().start(CalibrationKind.PIVOT, stylus)
    status = spin_until(panel_logic, lambda now: "Good enough" in now.calibration.text)
    assert status.calibration.text.startswith("pivot of the stylus: recording")
    panel_logic.calibration().stop()
    spin_until(panel_logic, lambda now: now.calibration.can_use)
    panel_logic.calibration().use()
    status = spin_until(panel_logic, lambda now: "mm from the sensor, sigma" in now.stylus)
    found = panel_logic.session.commands().content.stylus.tip
    assert np.linalg.norm(found.translation_mm - STYLUS_TIP_MM) < 0.5
    assert tip(panel_logic) is before
    assert "set_stylus_tip from the panel accepted: the first tip" in status.request
    assert "calibration" not in status.reasons
    spin_until(panel_logic, lambda _: node_of(application, "StylusModel") is not None)
    panel_logic.contour.add_tip(stylus)
    status = spin_until(panel_logic, lambda now: "1 point" in now.contour.text)


def test_robot_is_registered_by_the_dwells_of_a_replay(
    panel_logic, recorded, monkeypatch, tmp_path
):
    dwells = open_case(cut_case(tmp_path / "case", [(0.0, DWELLS_END_S + 0.2)]))
    opened = replace(recorded, case=replace(recorded.case, case=dwells))
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: opened)
    panel_logic.set_rate(20.0)
    panel_logic.load_case(CASE)
    spin_until(panel_logic, lambda now: now.position_s is not None and now.touch.can_start)
    before = panel_logic.session.commands().content.registration
    panel_logic.touch().start()
    panel_logic.play()
    spin_until(panel_logic, lambda now: now.position_s > DWELLS_END_S)
    panel_logic.touch().stop()
    panel_logic.pause()
    status = spin_until(panel_logic, lambda now: now.touch.can_use)
    assert [row[0] for row in status.touch.rows] == [str(n) for n in range(1, DWELLS + 1)]
    assert all(0.0 < float(residual) < 1.5 for _, residual, _ in status.touch.rows)
    assert "Good enough" in status.touch.text

    with pytest.raises(InputError, match="no point is selected"):
        panel_logic.touch().remove(-1)
    panel_logic.touch().remove(2)
    status = spin_until(panel_logic, lambda now: len(now.touch.rows) == DWELLS - 1)
    assert status.touch.can_restore
    panel_logic.touch().restore()
    spin_until(panel_logic, lambda now: len(now.touch.rows) == DWELLS and now.touch.can_use)
    panel_logic.touch().use()
    status = spin_until(panel_logic, lambda now: now.touch.can_undo)
    used = panel_logic.session.commands().content.registration
    assert used is not before and used.accepted and len(used.used) == DWELLS
    panel_logic.step()
    spin_until(panel_logic, lambda now: "registration" in now.reasons)
    panel_logic.touch().undo()
    spin_until(panel_logic, lambda now: not now.touch.can_undo)
    assert panel_logic.session.commands().content.registration is before


def test_commands_of_a_session_that_is_over_are_refused(replayed):
    calibration = replayed.calibration()
    calibration.start(CalibrationKind.PIVOT)
    with pytest.raises(InputError, match="changed it meanwhile"):
        calibration.stop()  # nothing of the new recording was shown yet
    spin_until(replayed, lambda now: now.calibration.is_recording)
    replayed.end_session()
    status = replayed.spin()
    assert not (status.calibration.can_start or status.touch.can_start)
    with pytest.raises(InputError, match="there is no session"):
        replayed.calibration()


def test_widgets_show_coverage_and_points(panel):
    from app.runtime import Coverage
    from MarginGuardLib.guided import GuidedShown

    ui, section = panel.ui, panel._sections._guided
    covered = Coverage(np.array([[20.0, 20.0]]), (True, *(False,) * 7), 0.5)
    rows = (("1", "0.21", "0.34"), ("2", "0.30", ""))
    calibration = GuidedShown("pivot: recording", covered, can_start=True, is_recording=True)
    touched = GuidedShown("2 points", rows=rows, can_start=True, can_restore=True)
    section.show(calibration, touched, "")
    image = ui.coverageLabel.pixmap().toImage()
    sector = image.pixelColor(140, 60)  # right of the middle, a little above: the first sector
    other = image.pixelColor(140, 90)
    assert (sector.name(), other.name()) == ("#4c9f70", "#d8dee3")
    assert image.pixelColor(105, 45).lightness() < 60  # the pose
    table = ui.touchTableWidget
    cells = [[table.item(row, column).text() for column in range(3)] for row in range(2)]
    assert cells == [list(row) for row in rows]
    assert ui.stopCalibrationButton.isEnabled() and not ui.useCalibrationButton.isEnabled()
    assert ui.restorePointButton.isEnabled() and ui.removePointButton.isEnabled()
    section.show(GuidedShown(), GuidedShown(), "")
    assert ui.coverageLabel.pixmap().isNull()
    assert table.rowCount() == 0
    assert not ui.startPivotButton.isEnabled()


def test_point_of_the_selected_row_is_removed(panel, application):
    from MarginGuardLib.guided import GuidedShown
    from tests.slicer_module.test_marginguard_panel import CommandsDouble

    rows = (("1", "", ""), ("2", "", ""))
    panel._sections._guided.show(GuidedShown(), GuidedShown(rows=rows), "")
    commands = CommandsDouble(panel.logic.panel_logic)
    panel.logic.panel_logic = commands
    panel.ui.touchTableWidget.selectRow(1)
    panel.ui.touchTableWidget.setCurrentCell(1, 0)
    panel.ui.removePointButton.click()
    panel.logic.panel_logic = commands.panel_logic
    assert commands.calls == [("touch.remove", 1)]
