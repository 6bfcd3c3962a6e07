"""Guided calibration of tool and stylus in the panel, in a live session with a moving tool."""

import numpy as np
import pytest

from app.geometry import InputError
from app.runtime import CalibrationKind, TrackedTool
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import node_of, spin_until
from tests.viewer.calibrated_tool import (
    KNOWN_MM,
    SHAFT,
    STYLUS_TIP_MM,
    TIP_MM,
    move,
    write_session,
)

pytestmark = pytest.mark.long


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
