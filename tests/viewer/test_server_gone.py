"""A page whose server has died, stands still or has ended does not go on looking alive."""

import re
import signal

from playwright.sync_api import Page, WebSocketRoute, expect

from app.fixture import MarginState
from tests.viewer.conftest import SIZE, watching

GREY = f"rgb({', '.join(str(round(255 * part)) for part in MarginState.UNKNOWN.color)})"


def check_lost(page: Page) -> None:
    """What lies at the picture, the banner and the digits is the grey cover, and it has words."""
    expect(page.locator("#lost")).to_be_visible(timeout=3000)
    expect(page.locator("#lost strong")).to_have_text("CONNECTION LOST")
    at = "[[100, 300], [innerWidth - 100, 80], [innerWidth - 200, 200], [innerWidth / 2, 600]]"
    assert page.evaluate(
        f"{at}.every(([x, y]) => document.elementFromPoint(x, y).closest('#lost'))"
    )
    colour = page.locator("#lost").evaluate("e => getComputedStyle(e).backgroundColor")
    assert colour == GREY


def test_a_server_that_stands_still_is_lost_until_it_goes_on_and_one_that_was_killed_is_lost(
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


def test_a_page_of_another_machine_without_encryption_watches_too(browser, server):
    """Browsers keep some calls from a page that came by plain http from another address."""
    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.add_init_script("delete Crypto.prototype.randomUUID")
    page.goto(server.url)
    page.wait_for_selector("body:not([data-lost]) #word")
    expect(page.locator("body")).to_have_attribute("data-picture", re.compile("."))
    context.close()


def test_a_page_whose_watch_does_not_run_is_covered(browser, server):
    """Its words would go on to come, and would stay when the server dies."""
    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.route("**/watch.js", lambda route: route.abort())
    page.goto(server.url)
    page.wait_for_selector("#word", state="attached")
    cover = "getComputedStyle(document.body, '::after')"
    assert page.evaluate(f"{cover}.content").startswith('"UNKNOWN: ')
    colour, *places = page.evaluate(
        f"['backgroundColor', 'position', 'inset', 'display'].map(name => {cover}[name])"
    )
    assert (colour, places) == (GREY, ["fixed", "0px", "grid"])
    context.close()


def test_a_page_that_is_not_heard_is_grey_although_heartbeats_come(browser, server):
    """Nobody draws for a page that says nothing: the last picture would stay, green, for ever."""
    heard = True

    def connect(socket: WebSocketRoute) -> None:
        above = socket.connect_to_server()
        socket.on_message(lambda message: above.send(message) if heard else None)

    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.route_web_socket("**/ws", connect)
    page.goto(server.url)
    page.wait_for_selector("body:not([data-lost]) #word")
    heard = False
    expect(page.locator("#lost strong")).to_have_text("PICTURE LATE")
    context.close()
