"""Guided registration on the live page: dwells of the shipped case, played to a session."""

import re

import pytest
import yaml
from playwright.sync_api import expect

from tests.bridge.live.conftest import start as start
from tests.viewer.conftest import watching
from tests.viewer.page_actions import choose, confirm
from tests.viewer.test_calibration_page import look

pytestmark = pytest.mark.long

CASE = "package://marginguard/recorded_case"
POINTS, START_S = 6, 4.4
"""The first two of its eight dwells end before."""
SHIFT_MM = 3.0


@pytest.fixture
def live_server(serve_live, tmp_path, project_root):
    """A session whose given registration is 3 mm off."""
    values = yaml.safe_load((project_root / "data" / "live_example" / "live.yaml").read_text())
    values["registration"]["matrix"][3] += SHIFT_MM
    values["margins"]["stale_after_ms"] = 1000
    config = tmp_path / "live.yaml"
    config.write_text(yaml.safe_dump(values, sort_keys=False))
    return serve_live(config)


@pytest.mark.timeout(900)
def test_robot_is_registered_by_touch_and_the_registration_undone(browser, live_server, start):
    with watching(browser, live_server) as watched:
        page = watched.page
        numbers, verdict = page.locator("#fre"), page.locator("#registration-verdict")
        choose(page, "prepare", "register")
        page.click("#registration-start")
        start("-m", "app.cli", "tracker", CASE, "--start", START_S)
        rows = page.locator("#registration tbody tr")
        expect(rows).to_have_count(POINTS)
        expect(verdict).to_have_attribute("data-ok", "true")
        page.click("#registration-stop")
        page.locator("#registration-use").wait_for()
        look(page, "registration", "#registration")

        page.click("#registration tbody tr:first-child button")
        expect(rows).to_have_count(POINTS - 1)
        page.click("#registration-restore")
        expect(rows).to_have_count(POINTS)

        expect(numbers).to_have_text("uncertainty not known")
        confirm(page, "registration-use")
        expect(numbers).to_contain_text(re.compile(rf"{POINTS} points, FRE 0\.[12]"))
        cause = page.locator("#causes li", has_text="registration replaced: the base is moved by ")
        moved_mm = float(cause.inner_text().split("moved by ")[1].split(" mm")[0])
        assert abs(moved_mm - SHIFT_MM) < 0.5
        confirm(page, "registration-undo")
        expect(numbers).to_have_text("uncertainty not known")
        assert not watched.external_requests()
        assert not watched.errors
