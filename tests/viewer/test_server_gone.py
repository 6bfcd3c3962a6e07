"""A page covers itself when its server has died, hangs or has ended."""

import re
import signal

from playwright.sync_api import expect

from app.fixture import MarginState
from tests.viewer.conftest import SIZE, watching

GREY = f"rgb({', '.join(str(round(255 * part)) for part in MarginState.UNKNOWN.color)})"


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


def test_page_is_covered_while_the_server_is_stopped_and_after_it_was_killed(
    browser, serve, viewed_case
):
    server = serve(str(viewed_case))
    with watching(browser, server) as watched:
        expect(watched.page.locator("#lost")).to_be_hidden()
        server.process.send_signal(signal.SIGSTOP)
        check_lost(watched.page)
        expect(watched.page.locator("body")).to_have_attribute("data-unknown-rung", re.compile("."))
        server.process.send_signal(signal.SIGCONT)
        expect(watched.page.locator("#lost")).to_be_hidden()
        server.process.kill()
        check_lost(watched.page)


def test_watchdog_runs_without_encryption_on_another_machine(browser, server):
    """Browsers withhold some functions from pages loaded by plain http from another machine."""
    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.add_init_script("delete Crypto.prototype.randomUUID")
    page.goto(server.url)
    page.wait_for_selector("body:not([data-lost]) #state-label")
    expect(page.locator("body")).to_have_attribute("data-picture", re.compile("."))
    context.close()


def test_page_without_watchdog_is_covered(browser, server):
    """Without a watchdog the last values would stay visible after the server has died."""
    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.route("**/watch.js", lambda route: route.abort())
    page.goto(server.url)
    page.wait_for_selector("#state-label", state="attached")
    cover = "getComputedStyle(document.body, '::after')"
    assert page.evaluate(f"{cover}.content").startswith('"UNKNOWN: ')
    colour, *places = page.evaluate(
        f"['backgroundColor', 'position', 'inset', 'display'].map(name => {cover}[name])"
    )
    assert (colour, places) == (GREY, ["fixed", "0px", "grid"])
    context.close()


def test_page_whose_requests_are_lost_is_covered_despite_heartbeats(browser, server):
    """The server sends no picture before the last one is acknowledged: an old one would stay."""
    forwards = True

    def connect(socket):
        above = socket.connect_to_server()
        socket.on_message(lambda message: above.send(message) if forwards else None)

    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.route_web_socket("**/ws", connect)
    page.goto(server.url)
    page.wait_for_selector("body:not([data-lost]) #state-label")
    forwards = False
    expect(page.locator("#lost strong")).to_have_text("PICTURE LATE")
    context.close()
