"""axe-core finds no violation of WCAG 2.2 A and AA on the page, in each state and size."""

import pytest
from playwright.sync_api import expect

from tests.page_rules import violations
from tests.viewer.conftest import watching
from tests.viewer.page_actions import choose, resize, show_frame
from tests.viewer.viewed_case import BREACH_FRAME, LOST

pytestmark = pytest.mark.long

DESKTOP, PHONE, TABLET = (1920, 1080), (390, 844), (768, 1024)


@pytest.mark.parametrize("size", [DESKTOP, PHONE, TABLET], ids=["desktop", "phone", "tablet"])
def test_page_has_no_violations(page, size):
    resize(page, *size)
    assert violations(page) == []


@pytest.mark.parametrize("mode", ["prepare", "operate", "review"])
def test_modes_have_no_violations(page, mode):
    choose(page, mode)
    show_frame(page, 39)
    expect(page.locator("#state-label")).to_have_text("HOLD")
    page.click("#applied summary")
    assert violations(page) == []
    page.click("#applied summary")
    choose(page, "review")


@pytest.mark.parametrize(
    ("frame", "label"), [(15, "CLOSE"), (BREACH_FRAME, "IN TUMOUR"), (LOST[0], "UNKNOWN")]
)
def test_states_have_no_violations(page, frame, label):
    resize(page, *DESKTOP)
    show_frame(page, frame)
    expect(page.locator("#state-label")).to_have_text(label)
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


def test_page_of_a_viewer_has_no_violations(browser, server):
    with watching(browser, server, server.view_url) as viewer:
        assert violations(viewer.page) == []
