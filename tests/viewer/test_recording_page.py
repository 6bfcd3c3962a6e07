"""A live session is recorded from the page: a button with a question, its status, its case."""

import pytest
from playwright.sync_api import expect

from app.case import open_case
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.bridge.live.test_record_command import SENDER, TRACKED
from tests.page_rules import violations
from tests.viewer.conftest import watching
from tests.viewer.page_actions import accepted, choose

pytestmark = pytest.mark.long


@pytest.fixture
def cases(tmp_path):
    return tmp_path / "cases"


@pytest.fixture
def live_server(serve_live, live_yaml, cases):
    config = live_yaml(TRACKED)
    with config.open("a") as file:
        file.write("needle: {frame: needle, length_mm: 60}\n")
    return serve_live(config, "--cases", str(cases))


@pytest.mark.timeout(900)
def test_session_is_recorded_from_the_page(browser, live_server, cases, start, frames_file):
    with watching(browser, live_server) as watched:
        page, count = watched.page, watched.page.locator("#recording .count")
        start(str(SENDER), str(frames_file), "tracked", "again")
        choose(page, "operate")
        expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
        expect(page.locator("#needle-length")).to_have_text("60")
        page.get_by_role("button", name="Needle 5 mm longer").click()
        expect(page.locator("#needle-length")).to_have_text("65")
        page.get_by_role("button", name="Needle 1 mm shorter").click()
        expect(page.locator("#needle-length")).to_have_text("64")
        expect(page.locator("#request")).to_contain_text(accepted("needle_length"))
        page.click("#record summary")
        expect(page.locator("#record-question")).to_contain_text("Record every source")
        page.fill("#record-name", "../up")
        page.click("#record-confirm")
        assert page.locator("#record-name:invalid").count() == 1
        page.fill("#record-name", "today")
        page.click("#record-confirm")
        expect(page.locator("#recording-mark")).to_be_visible()
        expect(page.locator("#recording-folder")).to_have_text(str(cases / "today"))
        expect(page.locator("#recording-numbers")).not_to_contain_text(" 0 messages")
        expect(page.locator("#request")).to_contain_text(accepted("record"))
        with watching(browser, live_server, live_server.view_url) as seen:
            expect(seen.page.locator("#recording-mark")).to_be_visible()
            expect(seen.page.locator("#record")).to_have_count(0)
            expect(seen.page.locator("#needle-length")).to_have_text("64")
            expect(seen.page.locator("#needle button")).to_have_count(0)
        assert violations(page) == []
        while not any(True for _ in open_case(cases / "today").recorded_frames()):
            page.wait_for_timeout(200)
        assert open_case(cases / "today").manifest.items["needle"].length_mm == 64.0
        page.click("#record summary")
        expect(page.locator("#record-name")).to_be_hidden()
        page.click("#record-confirm")
        expect(count).to_have_text("finished")
        expect(page.locator("#recording-mark")).to_have_count(0)
        page.click("#record summary")
        page.fill("#record-name", "today")
        page.click("#record-confirm")
        expect(page.locator("#request")).to_contain_text("already exists; refusing to overwrite")
        assert violations(page) == []
        assert watched.errors == []
    assert (cases / "today" / "tracking" / "metadata.yaml").exists()
