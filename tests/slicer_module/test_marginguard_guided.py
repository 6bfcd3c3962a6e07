"""Guided calibration and registration by touch in the panel, with the engine of the page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import marginguard as mg
from app.case import open_case
from app.geometry import InputError
from app.workflow import CalibrationKind, Coverage, GuidedShown, TouchedPoint
from tests.slicer_module.marginguard_module import CASE, frame_times_s, frames_in, spin_until, step
from tests.viewer.calibrated_tool import KNOWN_MM, NOISE_MM, NOISE_RAD, RATE_HZ, SHAFT, TIP_MM, Tool

pytestmark = pytest.mark.slow

MOTION_FRAMES = 250
DWELLS = 8
DWELLS_END_S = 19.0


@pytest.fixture
def panel_logic(unconnected):
    return unconnected


def ball(frame, radius_mm):
    shape = trimesh.creation.icosphere(3, radius_mm)
    return mg.SurfaceMesh(frame, shape.vertices, shape.faces)


def identity(target, source):
    return mg.Transform.identity(target, source)


def noisy_poses():
    """Frames of a tool that swings about its tip and then turns about its shaft."""
    tool, rng = Tool(), np.random.default_rng(3)
    for index in range(2 * MOTION_FRAMES):
        rotation, place_mm = tool.move("pivot" if index < MOTION_FRAMES else "spin", 2.0 / RATE_HZ)
        noisy = rotation * Rotation.from_rotvec(rng.normal(0.0, NOISE_RAD, 3))
        place_mm = place_mm + rng.normal(0.0, NOISE_MM, 3)
        yield (
            index / RATE_HZ,
            [
                identity("tracker", "reference"),
                mg.Transform("tracker", "needle", np.eye(3), [0.0, 0.001 * index, 20.0]),
                mg.Transform("tracker", "cautery", noisy.as_matrix(), place_mm),
            ],
        )


@pytest.fixture
def moving_tool(tmp_path):
    """A case of `noisy_poses`; the tip in the case is 3.5 mm off."""
    return mg.write_case(
        tmp_path / "case",
        noisy_poses(),
        tool=ball("cautery_tip", 1.0),
        tool_from_tip=mg.Transform("cautery", "cautery_tip", np.eye(3), KNOWN_MM),
        tumor=ball("tumor", 8.0),
        frame_from_tumor=identity("needle", "tumor"),
        margins=mg.MarginParameters(1.0, 5.0, 2.0, 50.0, 200_000_000, 3, 0.5, 10**9),
        name="moving tool",
        provenance="simulated",
        source="a test",
    )


def tip(panel_logic):
    return panel_logic.session.started().content.tool_from_tip


def play_frames(panel_logic, count):
    panel_logic.session.replay().player.step(count)


def stop_and_use(panel_logic):
    do(panel_logic.calibration(), "stop")
    spin_until(panel_logic, lambda now: now.calibration.can_use)
    use(panel_logic, panel_logic.calibration())


def do(recording, command, *args):
    """Run a command of an operator who has seen the present revision."""
    getattr(recording, command)(recording.status().revision, *args)


def use(panel_logic, recording):
    """Use the result; wait until no job runs, which the panel names with three dots."""
    do(recording, "accept")
    spin_until(panel_logic, lambda now: not now.message.endswith(" ..."))


def is_covered(status):
    return "8 of 8" in status.calibration.text and "Good" in status.calibration.text


def test_tool_is_calibrated_by_pivot_and_spin_and_undone(panel_logic, moving_tool):
    panel_logic.load_case(moving_tool)
    spin_until(panel_logic, lambda now: now.calibration.can_start)
    with pytest.raises(InputError, match="no robot"):
        panel_logic.touch()
    do(panel_logic.calibration(), "start", CalibrationKind.PIVOT)
    play_frames(panel_logic, 5)
    status = spin_until(panel_logic, lambda now: "Not yet: " in now.calibration.text)
    assert status.calibration.is_recording and not status.calibration.can_use
    assert "a pivot of the cautery is being recorded" in status.workflow

    play_frames(panel_logic, MOTION_FRAMES - 5)
    status = spin_until(panel_logic, is_covered)
    assert status.coverage.sectors == (True,) * 8
    assert "mm RMS" in status.calibration.text
    np.testing.assert_allclose(tip(panel_logic).translation_mm, KNOWN_MM, atol=1e-9)
    stop_and_use(panel_logic)
    status = spin_until(panel_logic, lambda now: now.calibration.can_undo)
    assert status.calibration.text == ""
    assert "set_tip from the panel accepted" in status.request
    pivoted = tip(panel_logic)
    assert np.linalg.norm(pivoted.translation_mm - TIP_MM) < 0.5
    assert "hold: calibration of the tool" in step(panel_logic).reasons

    do(panel_logic.calibration(), "start", CalibrationKind.SPIN)
    play_frames(panel_logic, MOTION_FRAMES - 5)
    spin_until(panel_logic, is_covered)
    stop_and_use(panel_logic)
    spin_until(panel_logic, lambda now: tip(panel_logic).angle_to(pivoted) > 0.0)
    assert np.degrees(np.arccos(tip(panel_logic).rotation[:, 2] @ SHAFT)) < 0.5
    do(panel_logic.calibration(), "undo")
    spin_until(panel_logic, lambda now: tip(panel_logic).angle_to(pivoted) == 0.0)


def test_robot_is_registered_by_the_dwells_of_a_replay(panel_logic, recorded, monkeypatch):
    dwells = open_case(CASE, frames=frames_in([(0.0, DWELLS_END_S + 0.2)])[::2])
    opened = replace(recorded, case=replace(recorded.case, case=dwells))
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: opened)
    panel_logic.load_case(CASE)
    spin_until(panel_logic, lambda now: now.position_s is not None and now.touch.can_start)
    before = panel_logic.session.started().content.registration
    do(panel_logic.touch(), "start")
    play_frames(panel_logic, sum(each < DWELLS_END_S for each in frame_times_s(opened)))
    spin_until(panel_logic, lambda now: now.position_s >= DWELLS_END_S)
    do(panel_logic.touch(), "stop")
    status = spin_until(panel_logic, lambda now: now.touch.can_use)
    points = status.touch.points
    assert [each.number for each in points] == list(range(1, DWELLS + 1))
    assert all(0.0 < float(each.residual) < 1.5 for each in points)
    assert "Good enough" in status.touch.text

    with pytest.raises(InputError, match="that point does not exist"):
        do(panel_logic.touch(), "remove", -1)
    do(panel_logic.touch(), "remove", int(points[2].id))
    status = spin_until(panel_logic, lambda now: len(now.touch.points) == DWELLS - 1)
    assert status.touch.can_restore
    do(panel_logic.touch(), "restore")
    spin_until(panel_logic, lambda now: len(now.touch.points) == DWELLS and now.touch.can_use)
    use(panel_logic, panel_logic.touch())
    status = spin_until(panel_logic, lambda now: now.touch.can_undo)
    used = panel_logic.session.started().content.registration
    assert used is not before and used.accepted and len(used.used) == DWELLS
    panel_logic.step()
    spin_until(panel_logic, lambda now: "registration" in now.reasons)
    do(panel_logic.touch(), "undo")
    spin_until(panel_logic, lambda now: not now.touch.can_undo)
    assert panel_logic.session.started().content.registration is before


def test_commands_of_a_session_that_is_over_are_refused(replayed):
    calibration = replayed.calibration()
    seen = replayed.refresh().calibration.revision
    calibration.start(seen, CalibrationKind.PIVOT)
    with pytest.raises(InputError, match="changed it meanwhile"):
        calibration.stop(seen)  # nothing of the new recording was shown yet
    spin_until(replayed, lambda now: now.calibration.is_recording)
    replayed.end_session()
    status = replayed.refresh()
    assert not (status.calibration.can_start or status.touch.can_start)
    with pytest.raises(InputError, match="there is no session"):
        replayed.calibration()


ROWS = (("1", "0.21", "0.34"), ("2", "0.30", ""))
POINTS = tuple(TouchedPoint(int(row[0]), f"{n}00", *row[1:], "") for n, row in enumerate(ROWS, 1))
TOUCHED = GuidedShown(3, "recording", points=POINTS, can_restore=True)


def show_guided(panel, calibration, touch, coverage=None):
    status = SimpleNamespace(calibration=calibration, touch=touch, coverage=coverage, tools=())
    panel._sections._guided.show(status)


def test_widgets_show_coverage_and_points(panel):
    ui = panel.ui
    covered = Coverage(np.array([[20.0, 20.0]]), (True, *(False,) * 7), 0.5)
    calibration = GuidedShown(1, "recording", title="pivot: recording")
    show_guided(panel, calibration, TOUCHED, covered)
    assert ui.calibrationLabel.text() == "pivot: recording"
    image = ui.coverageLabel.pixmap().toImage()
    sector = image.pixelColor(140, 60)  # right of the middle, a little above: the first sector
    other = image.pixelColor(140, 90)
    assert (sector.name(), other.name()) == ("#4c9f70", "#d8dee3")
    assert image.pixelColor(105, 45).lightness() < 60  # the pose
    table = ui.touchTableWidget
    cells = [[table.item(row, column).text() for column in range(3)] for row in range(2)]
    assert cells == [list(row) for row in ROWS]
    assert ui.stopCalibrationButton.isEnabled() and not ui.useCalibrationButton.isEnabled()
    assert ui.restorePointButton.isEnabled() and ui.removePointButton.isEnabled()
    show_guided(panel, GuidedShown(), GuidedShown())
    assert ui.coverageLabel.pixmap().isNull()
    assert table.rowCount() == 0
    assert not ui.startPivotButton.isEnabled()


def test_point_of_the_selected_row_is_removed(panel):
    from tests.slicer_module.test_marginguard_panel import CommandsDouble

    show_guided(panel, GuidedShown(), TOUCHED)
    commands = CommandsDouble(panel.logic.panel_logic)
    panel.logic.panel_logic = commands
    panel.ui.touchTableWidget.clearSelection()
    panel.ui.touchTableWidget.setCurrentCell(-1, -1)
    panel.ui.removePointButton.click()
    panel.ui.touchTableWidget.selectRow(1)
    panel.ui.touchTableWidget.setCurrentCell(1, 0)
    panel.ui.removePointButton.click()
    panel.logic.panel_logic = commands.panel_logic
    assert commands.calls == [("touch.remove", 3, 200)]
