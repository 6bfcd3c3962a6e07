"""What helps to navigate, in a browser: breaches that stay visible and can be visited."""

import pytest
from playwright.sync_api import expect

from app.session import STOP
from tests.viewer.conftest import reset
from tests.viewer.viewed_case import BREACH_FRAME, LOST

HISTORY = "1 breach so far, deepest 3.0 mm"


@pytest.fixture
def page(watched):
    """The page reset: paused at the first frame."""
    page = watched.page
    reset(page)
    expect(page.locator("#frame")).to_have_text("0")
    return page


def test_breaches_stay_visible_after_the_tool_has_left(page):
    expect(page.locator("#history")).to_have_count(0)
    expect(page.locator("#breach-count")).to_have_text("1 in the recording")
    page.keyboard.press("End")
    expect(page.locator("#state-label")).to_have_text("CLEAR")
    expect(page.locator("#history")).to_contain_text(f"clear now, {HISTORY}")


def test_list_of_breaches_leads_to_the_deepest_frame(page):
    row = page.locator("#breaches li")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("3.0 mm")
    expect(row).to_contain_text("right")
    row.get_by_role("button").click()
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
    expect(page.locator("#history")).to_contain_text(HISTORY)
    expect(row).to_have_attribute("aria-current", "true")


def test_keys_go_to_the_next_and_the_previous_breach(page):
    page.keyboard.press("n")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    page.keyboard.press("End")
    page.keyboard.press("p")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))


def test_unknown_says_what_to_do_in_words(page):
    for _ in range(LOST[0]):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    expect(page.locator("#todo")).to_contain_text("Bring tool and sensors into the tracker's view")
    page.keyboard.press("End")
    expect(page.locator("#todo")).to_have_count(0)


def test_set_up_that_cannot_be_right_is_said_from_the_first_frame(page):
    doubt = page.locator("#doubts li")
    expect(doubt).to_have_count(1)
    expect(doubt).to_contain_text("tool.tip_from: the tip is at the origin of the sensor 'rod'")


def test_tool_in_the_stop_margin_looks_different_from_one_at_the_warning_distance(page):
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


def test_directions_letters_and_scale_are_shown_with_the_picture(page):
    directions = page.locator("#directions li")
    expect(directions).to_have_count(6)
    texts = [text.split() for text in directions.all_inner_texts()]
    assert [letter for letter, _ in texts] == list("RLAPSI")
    # The rod stands beside the ball: its tip meets the margin in one direction at most.
    assert sum(value != "\N{EN DASH}" for _, value in texts) <= 1
    drawn = page.locator("#orientation")
    assert sorted(drawn.locator("g g text").all_text_contents()) == sorted("RLAPSI")
    values = page.evaluate("trame.state.get('orientation')")
    bar = page.locator("#scale-bar").evaluate("each => each.getBoundingClientRect().width")
    height = page.locator("main.view").evaluate("each => each.clientHeight")
    assert bar == pytest.approx(values["bar_px"] * height / values["height"], abs=3.0)
    for _ in range(LOST[0]):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    expect(directions).to_have_count(0)


def test_distance_tone_is_off_at_first_and_a_muted_one_is_shown(page):
    tone, body = page.locator("#distance-tone"), page.locator("body")
    expect(tone).to_have_attribute("aria-pressed", "false")
    go_to_state(page, "WARNING")
    assert body.get_attribute("data-distance-rung") is None
    page.keyboard.press("d")
    expect(tone).to_have_attribute("aria-pressed", "true")
    page.wait_for_function("Number(document.body.dataset.distanceRung) > 1")
    page.keyboard.press("m")
    expect(body).to_have_attribute("data-sound", "muted")
    shown = tone.evaluate("each => getComputedStyle(each, '::after').content")
    assert shown == '" (muted)"'
    tones, rung = [int(body.get_attribute(name) or 0) for name in COUNTERS]
    page.wait_for_function("n => Number(document.body.dataset.distanceRung) > n + 1", arg=rung)
    assert int(body.get_attribute("data-tones") or 0) == tones
    page.keyboard.press("m")
    page.keyboard.press("Home")
    page.keyboard.press("d")
    expect(tone).to_have_attribute("aria-pressed", "false")


COUNTERS = ("data-tones", "data-distance-rung")


def go_to_state(page, state):
    """Step forward to the first frame with this look."""
    for _ in range(BREACH_FRAME):
        if page.evaluate("trame.state.get('now').shown") == state:
            return
        frame = page.evaluate("trame.state.get('now').frame")
        page.keyboard.press("ArrowRight")
        expect(page.locator("#frame")).to_have_text(str(frame + 1))


@pytest.mark.parametrize(
    ("now", "period"),
    [
        ({"state": "NEGATIVE", "stop": "1.0", "warn": "5.0", "distance": "6.0"}, None),
        ({"state": "WARNING", "stop": "1.0", "warn": "5.0", "distance": "5.0"}, 1200),
        ({"state": "WARNING", "stop": "1.0", "warn": "5.0", "distance": "3.0"}, 675),
        ({"state": "WARNING", "stop": "1.0", "warn": "5.0", "distance": "0.4"}, 150),
        ({"state": "POSITIVE", "stop": "1.0", "warn": "5.0", "distance": "\N{MINUS SIGN}2"}, None),
        ({"state": "UNKNOWN", "stop": "", "warn": "", "distance": "\N{EN DASH}"}, None),
    ],
)
def test_distance_tone_repeats_faster_near_the_stop_margin(page, now, period):
    found = page.evaluate(
        "async (now) => (await import('/marginguard/alarm.js')).distancePeriod(now)", now
    )
    assert found == period


def test_help_lists_the_keys_and_keeps_them_from_the_replay(page):
    page.keyboard.press("?")
    dialog = page.locator("#help")
    expect(dialog).to_be_visible()
    expect(dialog).to_contain_text("next, previous breach")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("n")
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    expect(page.locator("#frame")).to_have_text("0")
    page.locator("#help-button").click()
    expect(dialog).to_be_visible()
    page.locator("#help-close").press("Enter")
    expect(dialog).to_be_hidden()


def test_tab_reaches_every_control(page):
    page.evaluate("document.activeElement.blur()")
    reached = set()
    controls = page.evaluate(
        """() => [...document.querySelectorAll('button, a[href], select, input, summary')].filter(
            (each) => each.checkVisibility() && !each.disabled).length"""
    )
    for _ in range(2 * controls):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.outerHTML"))
    names = "\n".join(reached)
    for part in ("Overview", 'id="sound"', 'id="help-button"', 'id="play"', 'id="timeline"'):
        assert part in names
    for part in ('id="distance-tone"', 'name="TUMOR"', 'type="range"', "<select", "deepest point"):
        assert part in names


PIXEL_MM = 24 * 25.4 / (1920**2 + 1080**2) ** 0.5
"""A pixel of a 24-inch screen of 1920 x 1080."""


@pytest.mark.parametrize(("selector", "height_mm"), [("#state-label", 12.0), ("#why", 6.0)])
def test_capitals_can_be_read_from_afar(page, selector, height_mm):
    page.set_viewport_size({"width": 1920, "height": 1080})
    pixels = page.locator(selector).evaluate(
        """(each) => {
            const context = document.createElement("canvas").getContext("2d");
            context.font = getComputedStyle(each).font;
            return context.measureText("H").actualBoundingBoxAscent;
        }"""
    )
    assert pixels * PIXEL_MM >= height_mm
