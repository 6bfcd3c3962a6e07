"""A page whose server has died, stands still or has ended does not go on looking alive."""

import signal

import pytest
from playwright.sync_api import expect

from tests.viewer.conftest import Serve

GREY = "rgb(128, 128, 128)"


@pytest.fixture
def server(serve: Serve, viewed_case):
    return serve(str(viewed_case))


def is_grey(page) -> bool:
    """Whether what lies at the picture, the banner and the digits is the grey cover."""
    at = "[[100, 300], [innerWidth - 100, 80], [innerWidth - 200, 200], [innerWidth / 2, 600]]"
    covered = page.evaluate(
        f"{at}.every(([x, y]) => document.elementFromPoint(x, y).closest('#lost'))"
    )
    colour = page.locator("#lost").evaluate("e => getComputedStyle(e).backgroundColor")
    return covered and colour == GREY


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGSTOP])
def test_the_page_turns_grey_and_says_why(watched, server, number):
    page = watched.page
    expect(page.locator("#lost")).to_be_hidden()
    server.process.send_signal(number)
    expect(page.locator("#lost strong")).to_have_text("CONNECTION LOST", timeout=3000)
    assert is_grey(page)
    if number is signal.SIGSTOP:
        server.process.send_signal(signal.SIGCONT)
        expect(page.locator("#lost")).to_be_hidden()
    if number is signal.SIGINT:
        assert server.process.wait() == 130
        assert server.log.read_text() == ""
