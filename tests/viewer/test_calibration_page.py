"""Guided calibration on the live page: a simulated tool is pivoted and spun in Chromium."""

import numpy as np
import pytest
from playwright.sync_api import expect

from app.files import read_transform
from tests.bridge.live.conftest import start as start
from tests.page_rules import violations
from tests.viewer.calibrated_tool import KNOWN_MM, SHAFT, TIP_MM, move, write_session
from tests.viewer.conftest import watching
from tests.viewer.page_actions import accepted, answer, choose, confirm, download, resize

pytestmark = pytest.mark.long

SIZES = {"wide": (1280, 720), "phone": (390, 844)}


def look(page, name, part="#calibration"):
    """No violation at either size."""
    for size, (width, height) in SIZES.items():
        resize(page, width, height)
        page.locator(part).scroll_into_view_if_needed()
        page.evaluate("scrollTo(0, 0)")  # the sticky state covers half a button where one scrolls
        assert violations(page) == [], (name, size)
    resize(page, 1280, 720)


def saved_tip(page, sensor="cautery"):
    """The tip that the session uses, from the page's file."""
    path = download(page, "#calibration-save")
    return read_transform(path, target=sensor, source=f"{sensor}_tip")


def use(page):
    """Stop, use the result, and wait until the session uses it."""
    page.click("#calibration-stop")
    confirm(page, "calibration-use")
    expect(page.locator("#calibration-title")).to_have_text("")


@pytest.mark.timeout(900)
def test_tool_is_calibrated_by_pivot_and_spin_and_undone(browser, serve_live, start, tmp_path):
    motion = tmp_path / "motion"
    move(motion, "narrow")
    with watching(browser, serve_live(write_session(tmp_path / "session"))) as watched:
        page = watched.page
        choose(page, "prepare", "calibrate")
        page.click("#calibration-pivot")
        expect(page.locator("#calibration-problem")).to_contain_text("No pose is recorded")
        tracker = start("-m", "tests.viewer.calibrated_tool", str(motion))
        verdict = page.locator("#calibration-verdict")
        expect(verdict).to_contain_text("Not yet: the poses of a pivot rotate")
        expect(page.locator("#calibration-advice")).to_contain_text("tilt the tool slowly")
        expect(page.locator("#workflow-calibrate .problem")).to_have_text(
            "a pivot of the cautery is being recorded"
        )
        # Without the step 4, navigate: where a late pose has latched a hold, it is not done.
        states = {0: "done", 1: "not done", 2: "done", 3: "not needed", 5: "not done"}
        for number, state in states.items():
            row = page.locator("#workflow li").nth(number)
            expect(row).to_have_attribute("data-state", state)
        look(page, "workflow", "#workflow")
        look(page, "not yet")

        move(motion, "pivot")
        expect(verdict).to_have_attribute("data-ok", "true")
        expect(page.locator("#calibration-covered")).to_contain_text("8 of 8")
        look(page, "good enough")
        before = saved_tip(page)
        np.testing.assert_allclose(before.translation_mm, KNOWN_MM, atol=1e-9)
        use(page)
        pivoted = saved_tip(page)
        assert np.linalg.norm(pivoted.translation_mm - TIP_MM) < 0.5
        np.testing.assert_allclose(pivoted.rotation, np.eye(3), atol=1e-9)
        expect(page.locator(".hold")).to_have_text("ON HOLD until re-armed")
        cause = page.locator("#causes li", has_text="calibration of the tool replaced: the tip is")
        expect(cause).to_be_visible()
        expect(page.locator("#request")).to_contain_text(accepted("set_tip"))

        move(motion, "spin")
        tracker.line(lambda line: line.strip() == "spin")
        page.click("#calibration-spin")
        expect(verdict).to_have_attribute("data-ok", "true")
        expect(page.locator("#calibration-covered")).to_contain_text("8 of 8")
        look(page, "spin")
        assert "another page has changed it meanwhile" in answer(page, "calibration_stop", 0)
        use(page)
        spun = saved_tip(page)
        np.testing.assert_allclose(spun.translation_mm, pivoted.translation_mm, atol=1e-9)
        assert np.degrees(np.arccos(spun.rotation[:, 2] @ SHAFT)) < 0.5

        confirm(page, "calibration-undo")
        while (undone := saved_tip(page)).angle_to(spun) == 0.0:
            page.wait_for_timeout(100)
        np.testing.assert_allclose(undone.matrix, pivoted.matrix, atol=1e-9)

        confirm(page, "rearm")
        expect(page.locator(".hold")).to_have_count(0)
        assert not watched.external_requests()
        assert not watched.errors
