"""A page covers itself when its server has died, hangs or has ended."""

import re
import signal

import pytest
from playwright.sync_api import expect

from app.fixture import MarginState
from tests.viewer.conftest import SIZE, watching
from tests.viewer.page_actions import show_frame, wait_until_uncovered

pytestmark = pytest.mark.long

GREY = f"rgb({', '.join(str(round(255 * part)) for part in MarginState.UNKNOWN.color)})"


@pytest.fixture
def new_page(browser):
    """A page that is not open yet."""
    context = browser.new_context(viewport=SIZE)
    yield context.new_page()
    context.close()


def check_lost(page):
    """Check that the grey cover lies over picture, banner and distance, with its message."""
    expect(page.locator("#lost")).to_be_visible()
    expect(page.locator("#lost strong")).to_have_text("CONNECTION LOST")
    at = "[[100, 300], [innerWidth - 100, 80], [innerWidth - 200, 200], [innerWidth / 2, 600]]"
    assert page.evaluate(
        f"{at}.every(([x, y]) => document.elementFromPoint(x, y).closest('#lost'))"
    )
    colour = page.locator("#lost").evaluate("e => getComputedStyle(e).backgroundColor")
    assert colour == GREY


def test_page_is_covered_while_the_server_is_stopped(browser, server):
    with watching(browser, server) as watched:
        show_frame(watched.page, 0)  # a known state, whatever the last page has shown
        server.process.send_signal(signal.SIGSTOP)
        try:
            check_lost(watched.page)
            rung = re.compile(".")
            expect(watched.page.locator("body")).to_have_attribute("data-unknown-rung", rung)
        finally:
            server.process.send_signal(signal.SIGCONT)
        expect(watched.page.locator("#lost")).to_be_hidden()


def test_watchdog_runs_without_encryption_on_another_machine(new_page, server):
    """Browsers withhold some functions from pages loaded by plain http from another machine."""
    new_page.add_init_script("delete Crypto.prototype.randomUUID")
    new_page.goto(server.url)
    wait_until_uncovered(new_page)
    expect(new_page.locator("body")).to_have_attribute("data-picture", re.compile("."))


def test_page_without_watchdog_is_covered(new_page, server):
    """Without a watchdog the last values would stay visible after the server has died."""
    new_page.route("**/watch.js", lambda route: route.abort())
    new_page.goto(server.url)
    new_page.wait_for_selector("#state-label", state="attached")
    cover = "getComputedStyle(document.body, '::after')"
    assert new_page.evaluate(f"{cover}.content").startswith('"UNKNOWN: ')
    colour, *places = new_page.evaluate(
        f"['backgroundColor', 'position', 'inset', 'display'].map(name => {cover}[name])"
    )
    assert (colour, places) == (GREY, ["fixed", "0px", "grid"])


def test_page_whose_requests_are_lost_is_covered_despite_heartbeats(new_page, server):
    """The server sends no picture before the last one is acknowledged: an old one would stay."""
    forwards = True

    def connect(socket):
        above = socket.connect_to_server()
        socket.on_message(lambda message: above.send(message) if forwards else None)

    new_page.route_web_socket("**/ws", connect)
    new_page.goto(server.url)
    wait_until_uncovered(new_page)
    forwards = False
    expect(new_page.locator("#lost strong")).to_have_text("PICTURE LATE")
