"""Several structures and tools on the page: lists, and a structure that is switched off and on."""

import pytest
from playwright.sync_api import expect

from tests.bridge.conftest import structures_yaml as structures_yaml
from tests.cli.small_case import write_two_tools
from tests.page_rules import violations
from tests.viewer.conftest import watching
from tests.viewer.page_actions import accepted, choose, show_frame

pytestmark = pytest.mark.long


@pytest.fixture
def live_server(serve_live, structures_yaml):
    """A session with three structures; no tracker sends poses."""
    return serve_live(structures_yaml)


@pytest.mark.timeout(900)
def test_structure_is_switched_off_and_on_from_the_page(browser, live_server):
    with watching(browser, live_server) as watched:
        page = watched.page
        row = page.locator("#structures li", has_text="chest wall")
        choose(page, "operate")
        expect(row.locator(".state")).to_have_text("? UNKNOWN")
        page.click("#switch summary")
        options = page.locator("#switch-name option")
        expect(options).to_have_text(["lesion 2", "chest wall"])
        page.select_option("#switch-name", "chest_wall")
        page.click("#switch-confirm")
        assert page.locator("#switch-reason:invalid").count() == 1
        page.fill("#switch-reason", "not in the field")
        assert violations(page) == []
        page.click("#switch-confirm")
        expect(row).to_contain_text("not guarded: not in the field")
        expect(page.locator("#request")).to_contain_text(accepted("switch_structure"))
        with watching(browser, live_server, live_server.view_url) as seen:
            expect(seen.page.locator("#structures")).to_contain_text("not in the field")
            expect(seen.page.locator("#switch")).to_have_count(0)
        page.click("#switch summary")
        expect(options).to_have_text(["lesion 2", "chest wall, off"])
        page.select_option("#switch-name", "chest_wall")
        expect(page.locator("#switch-question")).to_have_text("Guard this structure again?")
        page.click("#switch-confirm")
        expect(row.locator(".state")).to_have_text("? UNKNOWN")
        assert watched.errors == []


@pytest.mark.timeout(900)
def test_other_tool_is_listed_with_its_warning(browser, start_server, tmp_path):
    case = write_two_tools(tmp_path / "two")
    with watching(browser, start_server(str(case), "--tool", "rod")) as watched:
        row = watched.page.locator("#tools li")
        for frame, text, state in (
            (0, "tool 'left' is 2.0 mm away", "! CLOSE"),
            (6, "distance of tool 'left' is not known (invalid)", "? UNKNOWN"),
            (20, "left", "CHECK CLEAR"),
        ):
            show_frame(watched.page, frame)
            expect(row).to_contain_text(text)
            expect(row.locator(".state")).to_have_text(state.replace("CHECK", "\N{CHECK MARK}"))
            assert violations(watched.page) == []
        assert watched.errors == []
