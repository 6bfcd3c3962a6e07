"""Navigation in a browser: breaches, the timeline, notes, directions and help."""

import re

import pytest
from playwright.sync_api import expect

from app.session import STOP
from app.viewer.page_values import readout
from tests.viewer.page_actions import (
    click_at,
    download,
    hover_at,
    press,
    read,
    show_frame,
    wait_for,
)
from tests.viewer.viewed_case import BREACH_FRAME, LOST

pytestmark = pytest.mark.long

HISTORY = "1 breach so far, deepest 3.0 mm"
BREACH = str(BREACH_FRAME)


@pytest.fixture(scope="module")
def first_frames(parts):
    """Number of the first frame of each look of the state."""
    looks = [readout(shown)["shown"] for shown in parts.feed.shown]
    return {look: looks.index(look) for look in looks}


def test_breaches_stay_visible_after_the_tool_has_left(page):
    expect(page.locator("#history")).to_have_count(0)
    expect(page.locator("#breach-count")).to_have_text("1 in the recording")
    page.keyboard.press("End")
    expect(page.locator("#state-label")).to_have_text("HOLD")  # of the lost frames before
    expect(page.locator("#beside")).to_have_text("\N{CHECK MARK} margin CLEAR")
    expect(page.locator("#history")).to_contain_text(f"clear now, {HISTORY}")


def test_list_of_breaches_leads_to_the_deepest_frame(page):
    row = page.locator("#breaches li")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("3.0 mm")
    expect(row).to_contain_text("right")
    row.get_by_role("button").click()
    expect(page.locator("#frame")).to_have_text(BREACH)
    expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
    expect(page.locator("#history")).to_contain_text(HISTORY)
    expect(row).to_have_attribute("aria-current", "true")


def test_keys_and_buttons_go_to_breaches_and_not_beyond_the_last(page):
    expect(page.locator("#breach-previous")).to_be_disabled()
    for by_key in (True, False):
        for key, button, end in (("n", "next", "End"), ("p", "previous", "Home")):
            if by_key:
                press(page, key)
            else:
                page.click(f"#breach-{button}")
            expect(page.locator("#frame")).to_have_text(BREACH)
            press(page, end)
            expect(page.locator("#frame")).not_to_have_text(BREACH)
    show_frame(page, BREACH_FRAME)
    expect(page.locator("#breach-next")).to_be_disabled()


def test_unknown_says_what_to_do_in_words(page):
    show_frame(page, LOST[0])
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    expect(page.locator("#todo")).to_contain_text("Bring tool and sensors into the tracker's view")
    page.keyboard.press("End")
    expect(page.locator("#todo")).to_have_count(0)


def test_set_up_that_cannot_be_right_is_said_from_the_first_frame(page):
    doubt = page.locator("#doubts li")
    expect(doubt).to_have_count(1)
    expect(doubt).to_contain_text("tool.tip_from: the tip is at the origin of the sensor 'rod'")


def test_tool_in_the_stop_margin_looks_different_from_one_at_the_warning_distance(
    page, first_frames
):
    looks, box = {}, page.locator("section.state")
    for look in ("NEGATIVE", "WARNING", STOP, "POSITIVE"):
        show_frame(page, first_frames[look])
        assert read(page, "trame.state.get('now').shown") == look
        looks[look] = (
            box.evaluate("e => getComputedStyle(e).backgroundColor"),
            box.locator("i").inner_text(),
            page.locator("#state-label").inner_text(),
        )
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
    values = read(page, "trame.state.get('orientation')")
    bar = page.locator("#scale-bar").evaluate("each => each.getBoundingClientRect().width")
    height = page.locator("main.view").evaluate("each => each.clientHeight")
    assert bar == pytest.approx(values["bar_px"] * height / values["height"], abs=3.0)
    show_frame(page, LOST[0])
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    expect(directions).to_have_count(0)


def test_distance_tone_is_off_at_first_and_a_muted_one_is_shown(page, first_frames):
    def counted(name):
        return int(body.get_attribute(name) or 0)

    tone, body = page.locator("#distance-tone"), page.locator("body")
    expect(tone).to_have_attribute("aria-pressed", "false")
    show_frame(page, first_frames["WARNING"])
    assert body.get_attribute("data-distance-rung") is None
    page.keyboard.press("d")
    expect(tone).to_have_attribute("aria-pressed", "true")
    wait_for(page, "Number(document.body.dataset.distanceRung) > 1")
    page.keyboard.press("m")
    expect(body).to_have_attribute("data-sound", "muted")
    shown = tone.evaluate("each => getComputedStyle(each, '::after').content")
    assert shown == '" (muted)"'
    tones, rung = counted("data-tones"), counted("data-distance-rung")
    wait_for(page, "Number(document.body.dataset.distanceRung) > arg + 1", rung)
    assert counted("data-tones") == tones
    press(page, "m", "Home", "d")
    expect(tone).to_have_attribute("aria-pressed", "false")


@pytest.mark.parametrize(
    ("state", "distance", "period"),
    [
        ("NEGATIVE", "6.0", None),
        ("WARNING", "5.0", 1200),
        ("WARNING", "3.0", 675),
        ("WARNING", "0.4", 150),
        ("POSITIVE", "\N{MINUS SIGN}2", None),
        ("UNKNOWN", "\N{EN DASH}", None),
    ],
)
def test_distance_tone_repeats_faster_near_the_stop_margin(page, state, distance, period):
    known = state != "UNKNOWN"
    margins = {"stop": "1.0" if known else "", "warn": "5.0" if known else ""}
    found = page.evaluate(
        "async (now) => (await import('/marginguard/alarm.js')).distancePeriod(now)",
        {"state": state, "distance": distance, **margins},
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


def test_pointer_on_the_timeline_shows_time_distance_and_state(page):
    label, track = page.locator("#hover"), page.locator(".track")
    box = track.bounding_box()
    for frame, text in (
        (BREACH_FRAME, r"^1\.00 s: -[23]\.\d mm, in tumour$"),
        (LOST[1], r"^1\.55 s, unknown$"),
    ):
        x = box["x"] + box["width"] * frame / 39.0
        hover_at(track, x, box["y"] + box["height"] / 2.0)
        expect(label).to_have_text(re.compile(text))
    hover_at(page.locator("main.view"), 640, 300)
    expect(label).to_be_hidden()


def test_stop_and_warning_lines_are_named(page):
    labels = page.locator(".limit-label")
    expect(labels).to_have_text(["stop 1 mm", "warning 5 mm"])
    expect(page.locator("line.limit")).to_have_count(2)


def test_zoom_shows_the_present_larger_and_a_click_still_seeks(page):
    show_frame(page, BREACH_FRAME)
    for _ in range(2):
        page.click("#zoom-in")
    timeline, track = page.locator("#timeline"), page.locator(".track")
    expect(timeline).to_have_attribute("data-zoom", "4")
    plot, wide = timeline.bounding_box(), track.bounding_box()
    assert wide["width"] == pytest.approx(4.0 * plot["width"], rel=0.01)
    cursor = wide["x"] + wide["width"] * BREACH_FRAME / 39.0
    assert cursor == pytest.approx(plot["x"] + plot["width"] / 2.0, abs=2.0)
    x = wide["x"] + wide["width"] * 22.3 / 39.0
    click_at(timeline, x, plot["y"] + plot["height"] / 2.0)
    expect(page.locator("#frame")).to_have_text("22")
    press(page, "-", "-")
    expect(timeline).to_have_attribute("data-zoom", "1")


@pytest.mark.timeout(900)
def test_note_is_listed_marked_visited_and_in_the_report_that_is_downloaded(page):
    events = page.locator(".event").count()  # other tests of this page have left notes
    show_frame(page, BREACH_FRAME)
    page.click("#note-add")
    expect(page.locator("#note-answer")).to_have_text("note: 0 characters; expected 1 to 200")
    page.fill("#note-text", "scraped <b>here</b> 2?")
    page.press("#note-text", "Enter")
    # Keys that are typed neither mute nor change the camera.
    row = page.locator(".notes li", has_text="scraped <b>here</b> 2?")
    expect(row).to_have_count(1)
    expect(page.locator("#note-text")).to_have_value("")
    expect(page.locator("#note-answer")).to_be_hidden()
    expect(page.locator(".event")).to_have_count(events + 1)
    show_frame(page, 0)
    row.get_by_role("button").click()
    expect(page.locator("#frame")).to_have_text(BREACH)
    page.locator("#export summary").click()
    report = download(page, "#export-report-html", "report.html").read_text()
    page.locator("#export summary").click()
    assert "small: margin report" in report
    assert report.count("data:image/png;base64") == 2
    assert "event at 1.00 s (frame 20): scraped &lt;b&gt;here&lt;/b&gt; 2?" in report
