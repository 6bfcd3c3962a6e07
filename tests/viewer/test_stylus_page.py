"""A stylus on the live page: calibrated by a pivot and used for a point, in Chromium."""

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.bridge.live.conftest import start as start
from tests.viewer.calibrated_tool import KNOWN_MM, STYLUS, STYLUS_TIP_MM, move, write_session
from tests.viewer.conftest import watching
from tests.viewer.page_actions import accepted, choose, confirm
from tests.viewer.pictures import picture
from tests.viewer.test_calibration_page import look, saved_tip

pytestmark = pytest.mark.long


@pytest.mark.timeout(900)
def test_stylus_is_calibrated_and_points_without_a_change_of_the_tool(
    browser, serve_live, start, tmp_path
):
    motion = tmp_path / "motion"
    move(motion, "pivot")
    server = serve_live(write_session(tmp_path / "session", stylus=True))
    with watching(browser, server) as watched:
        page = watched.page
        start("-m", "tests.viewer.calibrated_tool", str(motion))
        tip, tool = page.locator("#stylus-tip"), page.locator('select[data-tool="calibrated"]')
        expect(tip).to_have_text("not calibrated")
        expect(page.locator("#state-label")).to_have_text("CLEAR")

        choose(page, "prepare", "contour")
        touch = page.locator('.contour-tools select[data-tool="touch"]')
        touch.select_option("stylus")
        page.click("#contour-tip")
        missing = "stylus: it is not calibrated; expected a pivot calibration before"
        expect(page.locator("#contour-note")).to_have_text(missing)
        choose(page, "prepare", "calibrate")
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
        expect(verdict).to_have_attribute("data-ok", "true")
        look(page, "stylus")
        picture(page, "stylus_pivot", "#calibration")
        page.click("#calibration-stop")
        confirm(page, "calibration-use")
        expect(tip).to_contain_text("mm from the sensor, sigma")
        expect(page.locator("#request")).to_contain_text(accepted("set_stylus_tip"))
        expect(page.locator("#causes li", has_text="calibration")).to_have_count(0)

        found = saved_tip(page, STYLUS)
        assert np.linalg.norm(found.translation_mm - STYLUS_TIP_MM) < 0.5
        tool.select_option("cautery")
        np.testing.assert_allclose(saved_tip(page).translation_mm, KNOWN_MM, atol=1e-9)

        choose(page, "prepare", "contour")
        page.click("#contour-tip")
        expect(page.locator("#contour-count")).to_have_text("1 point, 1 at the tip")
        choose(page, "operate")
        picture(page, "stylus_used", "#stylus")
        assert not watched.external_requests()
        # Of the tip that was not there.
        assert all("409 (Conflict)" in each for each in watched.errors)
