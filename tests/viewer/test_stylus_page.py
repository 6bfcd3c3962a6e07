"""A stylus on the live page: calibrated by a pivot and used for a point, in Chromium."""

import os
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

pytest.importorskip("rclpy")

from app.files import read_transform
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id
from tests.viewer.calibrated_tool import KNOWN_MM, STYLUS, STYLUS_TIP_MM, move, write_session
from tests.viewer.conftest import Server, watching
from tests.viewer.test_calibration_page import WAIT_MS, look, saved_tip


@pytest.fixture
def live_server(can_draw, domain_id, tmp_path):
    config = write_session(tmp_path / "session", stylus=True)
    server = Server(["--live", "--config", str(config)], tmp_path / "view.txt")
    yield server
    server.close()


def picture(page, name):
    """Save a picture of the page where ``MARGINGUARD_PICTURES`` names a folder."""
    folder = os.environ.get("MARGINGUARD_PICTURES")
    if folder:
        page.screenshot(path=Path(folder) / f"{name}.png")


def test_stylus_is_calibrated_and_points_without_a_change_of_the_tool(
    browser, live_server, start, tmp_path
):
    motion = tmp_path / "motion"
    move(motion, "pivot")
    with watching(browser, live_server) as watched:
        page = watched.page
        start("-m", "tests.viewer.calibrated_tool", str(motion))
        tip, tool = page.locator("#stylus-tip"), page.locator('select[data-tool="calibrated"]')
        expect(tip).to_have_text("not calibrated", timeout=WAIT_MS)
        expect(page.locator("#state-label")).to_have_text("CLEAR", timeout=WAIT_MS)

        touch = page.locator('.contour-tools select[data-tool="touch"]')
        touch.select_option("stylus")
        page.click("#contour-tip")
        missing = "stylus: it is not calibrated; expected a pivot calibration before"
        expect(page.locator("#contour-note")).to_have_text(missing)
        tool.select_option("stylus")
        page.click("#calibration-save")
        answer = page.locator("#calibration-answer")
        expect(answer).to_have_text("stylus: it has no calibrated tip; expected one to save")
        page.click("#calibration-spin")
        expect(answer).to_contain_text("spin: the tip of 'pointer' is at the sensor's origin")

        page.click("#calibration-pivot")
        title = page.locator("#calibration-title")
        expect(title).to_have_text("pivot of the stylus: recording")
        verdict = page.locator("#calibration-verdict")
        expect(verdict).to_have_attribute("data-ok", "true", timeout=WAIT_MS)
        look(page, "stylus")
        picture(page, "stylus_pivot")
        page.click("#calibration-stop")
        page.locator("#calibration-use summary").click(timeout=WAIT_MS)
        page.click("#calibration-use-confirm")
        expect(tip).to_contain_text("mm from the sensor, sigma", timeout=WAIT_MS)
        expect(page.locator("#request")).to_contain_text("set_stylus_tip from the page accepted")
        expect(page.locator("#causes li", has_text="calibration")).to_have_count(0)

        with page.expect_download() as download:
            page.click("#calibration-save")
        path = tmp_path / "stylus.yaml"
        download.value.save_as(path)
        found = read_transform(path, target=STYLUS, source=f"{STYLUS}_tip")
        assert np.linalg.norm(found.translation_mm - STYLUS_TIP_MM) < 0.5
        tool.select_option("cautery")
        before = saved_tip(page, tmp_path)
        np.testing.assert_allclose(before.translation_mm, KNOWN_MM, atol=1e-9)

        page.click("#contour-tip")
        expect(page.locator("#contour-count")).to_have_text(
            "1 point, 1 at the tip", timeout=WAIT_MS
        )
        page.locator("#stylus").scroll_into_view_if_needed()
        picture(page, "stylus_used")
        assert not watched.external_requests()
        assert all(
            "409 (Conflict)" in each for each in watched.errors
        )  # the tip that was not there
