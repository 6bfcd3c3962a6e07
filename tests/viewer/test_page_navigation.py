"""What helps to navigate, in a browser: breaches that stay visible and can be visited."""

import pytest
from playwright.sync_api import Page, expect

from app.session import STOP
from tests.viewer.conftest import SIZE, Watched
from tests.viewer.viewed_case import BREACH_FRAME, LOST

HISTORY = "1 breach so far, deepest 3.0 mm"


@pytest.fixture
def page(watched: Watched) -> Page:
    """The page reset: paused at the first frame."""
    page = watched.page
    page.set_viewport_size(SIZE)
    page.evaluate("document.activeElement.blur()")
    for key in ("ArrowLeft", "Home", "1"):
        page.keyboard.press(key)
    expect(page.locator("#frame")).to_have_text("0")
    return page


def test_breaches_stay_visible_after_the_tool_has_left(page: Page) -> None:
    expect(page.locator("#history")).to_have_count(0)
    expect(page.locator("#breach-count")).to_have_text("1 in the recording")
    page.keyboard.press("End")
    expect(page.locator("#state-label")).to_have_text("CLEAR")
    expect(page.locator("#history")).to_contain_text(f"clear now, {HISTORY}")


def test_list_of_breaches_leads_to_the_deepest_frame(page: Page) -> None:
    row = page.locator("#breaches li")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("3.0 mm")
    expect(row).to_contain_text("right")
    row.get_by_role("button").click()
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
    expect(page.locator("#history")).to_contain_text(HISTORY)
    expect(row).to_have_attribute("aria-current", "true")


def test_keys_go_to_the_next_and_the_previous_breach(page: Page) -> None:
    page.keyboard.press("n")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    page.keyboard.press("End")
    page.keyboard.press("p")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))


def test_unknown_says_what_to_do_in_words(page: Page) -> None:
    for _ in range(LOST[0]):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    expect(page.locator("#todo")).to_contain_text("Bring tool and sensors into the tracker's view")
    page.keyboard.press("End")
    expect(page.locator("#todo")).to_have_count(0)


def test_set_up_that_cannot_be_right_is_said_from_the_first_frame(page: Page) -> None:
    doubt = page.locator("#doubts li")
    expect(doubt).to_have_count(1)
    expect(doubt).to_contain_text("tool.tip_from: the tip is at the origin of the sensor 'rod'")


def test_tool_in_the_stop_margin_looks_different_from_one_at_the_warning_distance(
    page: Page,
) -> None:
    looks = {}
    for frame in range(BREACH_FRAME + 1):
        expect(page.locator("#frame")).to_have_text(str(frame))
        now = page.evaluate("trame.state.get('now')")
        box = page.locator("section.state")
        looks[now["shown"]] = (
            box.evaluate("e => getComputedStyle(e).backgroundColor"),
            box.locator("i").inner_text(),
            page.locator("#state-label").inner_text(),
        )
        page.keyboard.press("ArrowRight")
    assert set(looks) == {"NEGATIVE", "WARNING", STOP, "POSITIVE"}
    for column in zip(*looks.values(), strict=True):
        assert len(set(column)) == len(looks)
