"""Guided calibration on the live page: a simulated tool is pivoted and spun in Chromium."""

import numpy as np
import pytest
from playwright.sync_api import expect

pytest.importorskip("rclpy")

from app.files import read_transform
from tests.bridge.live.conftest import start as start
from tests.page_rules import violations
from tests.ros_domain import domain_id as domain_id
from tests.viewer.calibrated_tool import KNOWN_MM, SHAFT, TIP_MM, move, write_session
from tests.viewer.conftest import Server, watching

WAIT_MS = 60_000
ANSWER = """([name, args]) => trame.trigger(name, args)
  .then(() => "done", (error) => error.message)"""
SIZES = {"wide": (1280, 720), "phone": (390, 844)}


@pytest.fixture
def live_server(can_draw, domain_id, tmp_path):
    config = write_session(tmp_path / "session")
    server = Server(["--live", "--config", str(config)], tmp_path / "view.txt")
    yield server
    server.close()


def look(page, name, part="#calibration"):
    """No violation at either size."""
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.locator(part).scroll_into_view_if_needed()
        assert violations(page) == [], (name, size)
    page.set_viewport_size({"width": 1280, "height": 720})


def saved_tip(page, folder):
    """The tip that the session uses, from the page's file."""
    path = folder / "tip.yaml"
    with page.expect_download() as download:
        page.click("#calibration-save")
    download.value.save_as(path)
    return read_transform(path, target="cautery", source="cautery_tip")


def use(page):
    """Stop, use the result, and wait until the session uses it."""
    page.click("#calibration-stop")
    page.locator("#calibration-use summary").click(timeout=WAIT_MS)
    page.click("#calibration-use-confirm")
    expect(page.locator("#calibration-title")).to_have_text("", timeout=WAIT_MS)


def test_tool_is_calibrated_by_pivot_and_spin_and_undone(browser, live_server, start, tmp_path):
    motion = tmp_path / "motion"
    move(motion, "narrow")
    with watching(browser, live_server) as watched:
        page = watched.page
        page.click("#calibration-pivot")
        expect(page.locator("#calibration-problem")).to_contain_text("No pose is recorded")
        tracker = start("-m", "tests.viewer.calibrated_tool", str(motion))
        verdict = page.locator("#calibration-verdict")
        expect(verdict).to_contain_text("Not yet: the poses of a pivot rotate", timeout=WAIT_MS)
        expect(page.locator("#calibration-advice")).to_contain_text("tilt the tool slowly")
        expect(page.locator("#workflow-next")).to_contain_text(
            "calibrate: a pivot of the cautery is being"
        )
        page.click("#workflow summary")
        states = page.locator("#workflow li").evaluate_all("all => all.map((e) => e.dataset.state)")
        expected = ["done", "not done", "done", "not needed", "done", "not done"]
        assert states == expected
        look(page, "workflow", "#workflow")
        page.click("#workflow summary")
        look(page, "not yet")

        move(motion, "pivot")
        expect(verdict).to_have_attribute("data-ok", "true", timeout=WAIT_MS)
        expect(page.locator("#calibration-covered")).to_contain_text("8 of 8", timeout=WAIT_MS)
        look(page, "good enough")
        before = saved_tip(page, tmp_path)
        np.testing.assert_allclose(before.translation_mm, KNOWN_MM, atol=1e-9)
        use(page)
        pivoted = saved_tip(page, tmp_path)
        assert np.linalg.norm(pivoted.translation_mm - TIP_MM) < 0.5
        np.testing.assert_allclose(pivoted.rotation, np.eye(3), atol=1e-9)
        expect(page.locator(".hold")).to_have_text("ON HOLD until re-armed", timeout=WAIT_MS)
        cause = page.locator("#causes li", has_text="calibration of the tool replaced: the tip is")
        expect(cause).to_be_visible()
        expect(page.locator("#request")).to_contain_text("set_tip from the page accepted")

        move(motion, "spin")
        tracker.line(lambda line: line.strip() == "spin")
        page.click("#calibration-spin")
        expect(verdict).to_have_attribute("data-ok", "true", timeout=WAIT_MS)
        expect(page.locator("#calibration-covered")).to_contain_text("8 of 8", timeout=WAIT_MS)
        look(page, "spin")
        stale = page.evaluate(ANSWER, ["calibration_stop", [0]])
        assert "another page has changed it meanwhile" in stale
        use(page)
        spun = saved_tip(page, tmp_path)
        np.testing.assert_allclose(spun.translation_mm, pivoted.translation_mm, atol=1e-9)
        assert np.degrees(np.arccos(spun.rotation[:, 2] @ SHAFT)) < 0.5

        page.locator("#calibration-undo summary").click(timeout=WAIT_MS)
        page.click("#calibration-undo-confirm")
        undone = saved_tip(page, tmp_path)
        for _ in range(WAIT_MS // 100):
            if undone.angle_to(spun) > 0.0:
                break
            page.wait_for_timeout(100)
            undone = saved_tip(page, tmp_path)
        np.testing.assert_allclose(undone.matrix, pivoted.matrix, atol=1e-9)

        page.locator("#rearm summary").click(timeout=WAIT_MS)
        page.click("#rearm-confirm")
        expect(page.locator(".hold")).to_have_count(0, timeout=WAIT_MS)
        assert not watched.external_requests()
        assert not watched.errors
