"""Guided calibration of a stylus in the panel, in a live session with a moving tool."""

import numpy as np
import pytest

from app.geometry import InputError
from app.runtime import CalibrationKind, TrackedTool
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import node_of, spin_until
from tests.viewer.calibrated_tool import STYLUS_TIP_MM, move, write_session

pytestmark = pytest.mark.long


@pytest.fixture
def panel_logic(unconnected):
    return unconnected


def tip(panel_logic):
    return panel_logic.session.commands().content.tool_from_tip


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
