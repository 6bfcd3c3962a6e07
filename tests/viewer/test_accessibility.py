"""axe-core finds no violation of WCAG 2.2 A and AA on the page, in each state and size."""

import pytest
from playwright.sync_api import expect

from tests.page_rules import violations
from tests.viewer.conftest import Watched
from tests.viewer.viewed_case import LOST

DESKTOP, PHONE, TABLET = (1920, 1080), (390, 844), (768, 1024)


@pytest.fixture
def page(watched):
    """The page paused at the first frame."""
    page = watched.page
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Home")
    expect(page.locator("#frame")).to_have_text("0")
    return page


@pytest.mark.parametrize("size", [DESKTOP, PHONE, TABLET], ids=["desktop", "phone", "tablet"])
def test_page_has_no_violations(page, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    assert violations(page) == []


@pytest.mark.parametrize("state", ["WARNING", "POSITIVE", "UNKNOWN"])
def test_states_have_no_violations(page, state):
    page.set_viewport_size({"width": DESKTOP[0], "height": DESKTOP[1]})
    for number in range(1, LOST[0] + 1):
        page.keyboard.press("ArrowRight")
        expect(page.locator("#frame")).to_have_text(str(number))
        if page.evaluate("trame.state.get('now').state") == state:
            break
    assert page.evaluate("trame.state.get('now').state") == state
    assert violations(page) == []


def test_help_has_no_violations(page):
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    assert violations(page) == []
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()


def test_a_violation_is_found(page):
    """The rules are in use: an image without a text is one."""
    page.evaluate("document.querySelector('.view').append(new Image())")
    assert any(each.startswith("image-alt") for each in violations(page))


def test_page_of_a_viewer_has_no_violations(browser, serve, server):
    context = browser.new_context()
    viewer = Watched(context.new_page(), server.host)
    page = viewer.open(server.view_url)
    assert violations(page) == []
    context.close()
