"""The timeline in a browser: zoom, hover values, margin lines, breaches; event notes."""

import re

import pytest
from playwright.sync_api import expect

from tests.viewer.conftest import reset, wait_until_uncovered
from tests.viewer.viewed_case import BREACH_FRAME, LOST


@pytest.fixture
def page(watched):
    """The page reset: paused at the first frame."""
    page = watched.page
    reset(page)
    expect(page.locator("#frame")).to_have_text("0")
    return page


def hover(page, frame):
    box = page.locator(".track").bounding_box()
    wait_until_uncovered(page)
    page.mouse.move(box["x"] + box["width"] * frame / 39.0, box["y"] + box["height"] / 2.0)


def test_pointer_shows_time_distance_and_state(page):
    label = page.locator("#hover")
    hover(page, BREACH_FRAME)
    expect(label).to_have_text(re.compile(r"^1\.00 s: -[23]\.\d mm, in tumour$"))
    hover(page, LOST[1])
    expect(label).to_have_text(re.compile(r"^1\.55 s, unknown$"))
    page.mouse.move(640, 300)
    expect(label).to_be_hidden()


def test_stop_and_warning_lines_are_named(page):
    labels = page.locator(".limit-label")
    expect(labels).to_have_text(["stop 1 mm", "warning 5 mm"])
    expect(page.locator("line.limit")).to_have_count(2)


def test_zoom_shows_the_present_larger_and_a_click_still_seeks(page):
    page.click("#breach-next")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    for _ in range(2):
        page.click("#zoom-in")
    timeline = page.locator("#timeline")
    expect(timeline).to_have_attribute("data-zoom", "4")
    plot, track = timeline.bounding_box(), page.locator(".track").bounding_box()
    assert track["width"] == pytest.approx(4.0 * plot["width"], rel=0.01)
    cursor = track["x"] + track["width"] * BREACH_FRAME / 39.0
    assert cursor == pytest.approx(plot["x"] + plot["width"] / 2.0, abs=2.0)
    wait_until_uncovered(page)
    page.mouse.click(track["x"] + track["width"] * 22.3 / 39.0, plot["y"] + plot["height"] / 2.0)
    expect(page.locator("#frame")).to_have_text("22")
    page.evaluate("document.activeElement.blur()")
    for key in "--":
        page.keyboard.press(key)
    expect(timeline).to_have_attribute("data-zoom", "1")


def test_buttons_go_to_breaches_and_are_disabled_beyond_the_last(page):
    expect(page.locator("#breach-previous")).to_be_disabled()
    page.click("#breach-next")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    expect(page.locator("#breach-next")).to_be_disabled()
    page.keyboard.press("End")
    page.click("#breach-previous")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))


def test_note_is_listed_marked_visited_and_in_the_report(page):
    events = page.locator(".event").count()  # other tests of this page have left notes
    page.keyboard.press("n")
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
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
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Home")
    expect(page.locator("#frame")).to_have_text("0")
    row.get_by_role("button").click()
    expect(page.locator("#frame")).to_have_text(str(BREACH_FRAME))
    report = page.evaluate("() => fetch('report.html').then((answer) => answer.text())")
    assert "event at 1.00 s (frame 20): scraped &lt;b&gt;here&lt;/b&gt; 2?" in report
