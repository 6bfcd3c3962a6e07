"""Stylus and ultrasound probe of a live session in the panel, each sent by another process."""

import numpy as np
import pytest

from app.geometry import InputError
from app.scene.image_nodes import VOLUME_NAME
from app.workflow import CalibrationKind
from benchmarks.images import session as images
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import node_of, spin_until
from tests.slicer_module.test_marginguard_ultrasound import corners
from tests.viewer.calibrated_tool import STYLUS_TIP_MM, move, write_session

pytestmark = pytest.mark.long


@pytest.fixture
def panel_logic(unconnected):
    return unconnected


def tip(panel_logic):
    return panel_logic.session.started().content.tool_from_tip


def test_stylus_is_calibrated_beside_the_tool(panel_logic, application, start, tmp_path, domain_id):
    motion = tmp_path / "motion"
    move(motion, "pivot")
    panel_logic.connect(write_session(tmp_path / "session", stylus=True))
    start("-m", "tests.viewer.calibrated_tool", str(motion))
    status = spin_until(panel_logic, lambda now: now.calibration.can_start and now.contour.can_edit)
    assert status.items[0].text == "not calibrated"
    before = tip(panel_logic)
    stylus = "stylus"
    with pytest.raises(InputError, match=r"^stylus: it is not calibrated; expected a pivot"):
        panel_logic.contour.add_tip(stylus)
    with pytest.raises(InputError, match=r"^spin: the tip of 'pointer' is at the sensor's origin"):
        panel_logic.calibration().start(status.calibration.revision, CalibrationKind.SPIN, stylus)
    panel_logic.calibration().start(status.calibration.revision, CalibrationKind.PIVOT, stylus)
    status = spin_until(panel_logic, lambda now: "Good enough" in now.calibration.text)
    assert status.calibration.text.startswith("pivot of the stylus: recording")
    panel_logic.calibration().stop(status.calibration.revision)
    status = spin_until(panel_logic, lambda now: now.calibration.can_use)
    panel_logic.calibration().accept(status.calibration.revision)
    status = spin_until(panel_logic, lambda now: "mm from the sensor, sigma" in now.items[0].text)
    found = panel_logic.session.started().content.item("stylus").tip
    assert np.linalg.norm(found.translation_mm - STYLUS_TIP_MM) < 0.5
    assert tip(panel_logic) is before
    assert "set_stylus_tip from the panel (" in status.request
    assert ") accepted: the first tip" in status.request
    assert "calibration" not in status.reasons
    spin_until(panel_logic, lambda _: node_of(application, "StylusModel") is not None)
    panel_logic.contour.add_tip(stylus)
    status = spin_until(panel_logic, lambda now: "1 point" in now.contour.text)


def test_live_image_is_placed_by_the_chosen_depth_and_hidden_without_its_sender(
    panel_logic, application, start, tmp_path, domain_id
):
    matrix = images.PROBE_FROM_IMAGE @ np.diag([1.5, 1.5, 1.5, 1.0])
    calibrations = [
        {"depth_mm": 40, "path": "image_to_probe.txt"},
        {"depth_mm": 60, "matrix": matrix.ravel().tolist()},
    ]
    changes = {"calibrations": calibrations, "depth_mm": 40, "stale_after_ms": 2000}
    panel_logic.connect(images.write_session(tmp_path / "session", **changes))
    sender = start("-m", "benchmarks.images.sender")
    spin_until(panel_logic, lambda now: now.ultrasound.text.endswith("depth 40 mm"))
    width, height = 639, 479
    sides = np.linalg.norm(np.diff(corners(application), axis=0), axis=1)
    np.testing.assert_allclose(sides[:2], (0.1 * width, 0.1 * height), rtol=0, atol=1e-6)
    panel_logic.ultrasound.choose_depth(60.0)
    status = spin_until(panel_logic, lambda now: now.ultrasound.text.endswith("depth 60 mm"))
    assert status.request.endswith(") accepted: from 40 to 60 mm")
    assert (status.ultrasound.depth_mm, status.ultrasound.can_choose) == (60.0, True)
    sides = np.linalg.norm(np.diff(corners(application), axis=0), axis=1)
    np.testing.assert_allclose(sides[:2], (0.15 * width, 0.15 * height), rtol=0, atol=1e-6)
    sender.end(9)
    spin_until(panel_logic, lambda now: now.ultrasound.text.startswith("NO CURRENT IMAGE"))
    assert node_of(application, VOLUME_NAME).GetImageData() is None
