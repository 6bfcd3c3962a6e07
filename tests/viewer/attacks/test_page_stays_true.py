"""Pages in a browser: one that another client attacks stays true, one that may only see sees."""

import pytest
from playwright.sync_api import expect

from app.fixture import MarginState
from tests.viewer.attacks.raw_page import RawPage, message, raw_page
from tests.viewer.attacks.test_messages_served import EXITS, FORGERIES, POLICY
from tests.viewer.conftest import watching
from tests.viewer.page_actions import UNCOVERED, click_at, drag, press, read, show_frame, wait_for
from tests.viewer.viewed_case import BREACH_FRAME

pytestmark = pytest.mark.long

SCRIPT = "<img src=x onerror='window.attacked = true'>"
TEMPLATE = {
    "key": "trame__template_main",
    "value": f"<b id='state-label'>CLEAR 38.2 mm</b>{SCRIPT}",
}


@pytest.fixture
def page(page):
    """The page at a frame inside the tumour."""
    show_frame(page, BREACH_FRAME)
    return page


def check_true(page):
    expect(page.locator(UNCOVERED)).to_have_text("IN TUMOUR")
    assert page.locator("#distance").inner_text().startswith("\N{MINUS SIGN}")
    banner = page.get_by_role("status").evaluate("e => getComputedStyle(e).backgroundColor")
    red = [round(255 * part) for part in MarginState.POSITIVE.color]
    assert banner == f"rgb({', '.join(map(str, red))})"
    assert page.evaluate("window.attacked") is None


def pictures_continue(page):
    """Check that the page still gets new pictures."""
    before = page.evaluate("document.body.dataset.picture")
    page.keyboard.press("2")
    wait_for(page, "document.body.dataset.picture !== arg", before)


def test_template_state_and_picture_cannot_be_forged_and_the_server_not_ended(target, page):
    with target.bounded(), raw_page(target.server, target.operate) as attacker:
        attacker.greet()
        attacker.call("trame.state.update", [TEMPLATE])
        for method, args in EXITS + FORGERIES:
            attacker.call(method, *args)
        check_true(page)
        pictures_continue(page)
        check_true(page)


def test_client_that_reads_nothing_does_not_slow_the_page(target, page):
    """Its requests are answered until the answers fill the line; then it is disconnected."""
    with target.bounded():
        attackers = [RawPage(target.server, target.view).greet() for _ in range(8)]
        page.keyboard.press(" ")
        for attacker in attackers:
            for _ in range(5):
                attacker.frame(message("trame.state.get"))
                attacker.frame(message("marginguard.seen", 0))
        wait_for(page, "trame.state.get('now').frame > 35")
        page.keyboard.press("ArrowLeft")
        for attacker in attackers:
            attacker.close()


def test_flood_is_cut_off_while_the_page_stays_live(target, page):
    with target.bounded():
        for _ in range(4):
            with raw_page(target.server, target.view) as attacker:
                attacker.greet()
                for _ in range(1600):
                    attacker.frame(message("marginguard.seen", 0))
                assert attacker.ended() == POLICY
        check_true(page)
        pictures_continue(page)


def test_view_page_shows_the_picture_and_has_no_controls(browser, target, operator):
    refused = target.log.count("refused")
    with watching(browser, target.server, target.server.view_url) as watched:
        page, view = watched.page, watched.page.locator("main.view")
        expect(page.locator("#role")).to_have_text("VIEW ONLY")
        wait_for(page, "document.querySelector('main.view img').naturalWidth > 300")
        enabled = page.locator("button:enabled:visible, input:enabled:visible, select:enabled")
        # Of this browser alone: the mode, sounds, the list of keys and the part of the timeline.
        ids = {each.get_attribute("id") or each.get_attribute("name") for each in enabled.all()}
        assert ids == {"mode", "sound", "distance-tone", "help-button", "zoom-in", "zoom-out"}
        shown = "[trame.state.get('now').frame, trame.state.get('look')]"
        before = read(page, shown)
        press(page, " ", "ArrowRight", "End", "3")
        click_at(page.locator("#timeline"), 640, 640)
        drag(view, (300, 300), (400, 300))
        operator.call("trame.trigger", "part_opacity", ["TUMOR", 0.5], {})
        wait_for(page, "trame.state.get('parts')[0].opacity === 0.5")
        assert read(page, shown) == before
        operator.call("trame.trigger", "part_opacity", ["TUMOR", 1.0], {})
        assert watched.errors == []
        assert target.log.count("refused") == refused  # the page has not even tried
