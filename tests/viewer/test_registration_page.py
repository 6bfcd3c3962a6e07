"""Guided registration on the live page: the dwells of the shipped case, played to a session."""

import pytest
import yaml
from playwright.sync_api import expect

pytest.importorskip("rclpy")

from tests.bridge.live.conftest import start as start
from tests.page_rules import violations
from tests.ros_domain import domain_id as domain_id
from tests.viewer.conftest import Server, watching

WAIT_MS = 120_000
CASE = "package://marginguard/recorded_case"
POINTS = 8
SHIFT_MM = 3.0


@pytest.fixture
def live_server(can_draw, domain_id, tmp_path, project_root):
    """A session whose given registration is 3 mm off."""
    values = yaml.safe_load((project_root / "data" / "live_example" / "live.yaml").read_text())
    values["registration"]["matrix"][3] += SHIFT_MM
    values["margins"]["stale_after_ms"] = 1000
    config = tmp_path / "live.yaml"
    config.write_text(yaml.safe_dump(values, sort_keys=False))
    server = Server(["--live", "--config", str(config)], tmp_path / "view.txt")
    yield server
    server.close()


def test_robot_is_registered_by_touch_and_the_registration_undone(browser, live_server, start):
    with watching(browser, live_server) as watched:
        page = watched.page
        numbers, verdict = page.locator("#fre"), page.locator("#registration-verdict")
        page.locator("#registration-start").click(timeout=WAIT_MS)
        start("-m", "app.cli", "tracker", CASE)
        rows = page.locator("#registration tbody tr")
        expect(verdict).to_contain_text("expected at least 4", timeout=WAIT_MS)
        expect(rows).to_have_count(POINTS, timeout=WAIT_MS)
        expect(verdict).to_have_attribute("data-ok", "true", timeout=WAIT_MS)
        page.click("#registration-stop")
        page.locator("#registration-use").wait_for(timeout=WAIT_MS)
        for width, height in ((1280, 720), (390, 844)):
            page.set_viewport_size({"width": width, "height": height})
            page.locator("#registration").scroll_into_view_if_needed()
            assert violations(page) == []
        page.set_viewport_size({"width": 1280, "height": 720})

        page.click("#registration tbody tr:first-child button")
        expect(rows).to_have_count(POINTS - 1, timeout=WAIT_MS)
        page.click("#registration-restore")
        expect(rows).to_have_count(POINTS, timeout=WAIT_MS)

        expect(numbers).to_have_text("uncertainty not known")
        page.locator("#registration-use summary").click(timeout=WAIT_MS)
        page.click("#registration-use-confirm")
        expect(numbers).to_contain_text("8 points, FRE 0.2", timeout=WAIT_MS)
        cause = page.locator("#causes li", has_text="registration replaced: the base is moved by ")
        moved_mm = float(cause.inner_text().split("moved by ")[1].split(" mm")[0])
        assert abs(moved_mm - SHIFT_MM) < 0.5
        page.locator("#registration-undo summary").click(timeout=WAIT_MS)
        page.click("#registration-undo-confirm")
        expect(numbers).to_have_text("uncertainty not known", timeout=WAIT_MS)
        assert not watched.external_requests()
        assert not watched.errors
