"""Images of a live session on the page: their pixels, and why none is shown without a sender."""

import signal

import numpy as np
import pytest
import yaml
from playwright.sync_api import expect

from benchmarks.images.sender import image_values
from benchmarks.images.session import COLUMNS, PROBE_FROM_IMAGE, ROWS, write_session
from tests.bridge.live.conftest import start as start
from tests.viewer.conftest import watching
from tests.viewer.page_actions import accepted, choose, resize, wait_for
from tests.viewer.pictures import picture
from tests.viewer.test_ultrasound_page import pixels_of

pytestmark = pytest.mark.long

SENDER = ("-m", "benchmarks.images.sender")


WIDTH_OF_TUMOR = "() => document.querySelector('path.us-tumor').getBBox().width"


@pytest.fixture
def two_depths(serve_live, tmp_path):
    """Pixels of 0.1 mm, and at the other depth of 0.15 mm."""
    matrix = PROBE_FROM_IMAGE @ np.diag([1.5, 1.5, 1.5, 1.0])
    calibrations = [
        {"depth_mm": 40, "path": "image_to_probe.txt"},
        {"depth_mm": 60, "matrix": matrix.ravel().tolist()},
    ]
    config = write_session(
        tmp_path / "session", stale_after_ms=2000, calibrations=calibrations, depth_mm=40
    )
    values = yaml.safe_load(config.read_text())
    values["needle"] = {"frame": "needle", "length_mm": 60}
    values["cautery"] = {"topic": "/generator/active", "stale_after_ms": 60_000}
    config.write_text(yaml.safe_dump(values, sort_keys=False))
    return serve_live(config)


def test_operator_chooses_another_depth_after_a_question(browser, two_depths, start):
    with watching(browser, two_depths) as watched:
        page = watched.page
        choose(page, "operate")
        start(*SENDER)
        expect(page.locator("#us-time")).to_contain_text("depth 40 mm")
        page.locator("path.us-tumor[d^=M]").wait_for(state="attached")
        assert page.evaluate(WIDTH_OF_TUMOR) == pytest.approx(2 * 8.0 / 0.1, abs=3)
        expect(page.locator("#us-depth-used")).to_have_text("40 mm")
        page.click("#us-depth summary")
        expect(page.locator("#us-depth-choice option")).to_have_text(["40 mm", "60 mm"])
        page.select_option("#us-depth-choice", "60")
        picture(page, "ultrasound_depth", "#us-depth-confirm")
        resize(page, 390, 844)
        page.click("#us-depth-confirm", trial=True)  # nothing covers it
        resize(page, 1280, 720)
        page.click("#us-depth-confirm")
        expect(page.locator("#us-time")).to_contain_text("depth 60 mm")
        expect(page.locator("#us-depth-used")).to_have_text("60 mm")
        expect(page.locator("#us-depth")).not_to_have_attribute("open", "")
        wait_for(page, f"({WIDTH_OF_TUMOR})() < 115")
        assert page.evaluate(WIDTH_OF_TUMOR) == pytest.approx(2 * 8.0 / 0.15, abs=3)
        expected = accepted("image_depth", ": from 40 to 60 mm")
        expect(page.locator("#request")).to_contain_text(expected)
        assert not watched.errors


def test_live_image_is_shown_and_covered_without_its_sender(browser, serve_live, start, tmp_path):
    server = serve_live(write_session(tmp_path / "session", stale_after_ms=2000))
    with watching(browser, server) as watched:
        page, problem = watched.page, watched.page.locator("#us-problem")
        choose(page, "operate")
        part = page.locator("#ultrasound > div")
        expect(part).to_have_attribute("data-problem", "true")
        sender = start(*SENDER)
        expect(part).to_have_attribute("data-problem", "false")
        page.locator("path.us-tumor[d^=M]").wait_for(state="attached")
        page.click("#us-freeze")
        shown = pixels_of(page, ROWS, COLUMNS)
        assert shown.tobytes() in {image_values(number).tobytes() for number in range(16)}
        page.click("#us-freeze")
        with sender.held():
            expect(part).to_have_attribute("data-problem", "true")
            expect(problem).to_contain_text("NO CURRENT IMAGE")
            sender.end_input()
        sender.wait()  # it leaves the graph; if killed it would stay a second publisher for long
        refused = start(*SENDER, "--encoding", "bgr8")
        expect(problem).to_contain_text("encoding of the image is 'bgr8'")
        expect(page.locator("#us-image")).to_be_hidden()
        refused.end(signal.SIGKILL)
        assert not watched.external_requests()
        assert not watched.errors
