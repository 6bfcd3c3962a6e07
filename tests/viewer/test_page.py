"""The page in a browser, from its first request to its pixels."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Position, expect

from app.cli.main import main
from app.fixture import MarginState
from tests.viewer.conftest import Watched, reset, screenshot, wait_until_uncovered
from tests.viewer.viewed_case import BREACH_FRAME, LOST

MINUS = "\N{MINUS SIGN}"


@pytest.fixture
def page(watched):
    """The page reset: paused at the first frame, with the first camera."""
    page = watched.page
    reset(page)
    page.wait_for_function(
        "() => { const n = trame.state.get('now'); return n.frame === 0 && !n.playing; }"
    )
    return page


@pytest.fixture(scope="module")
def rows(viewed_case, tmp_path_factory):
    """The rows of ``margin.csv`` of a replay of the case."""
    report = tmp_path_factory.mktemp("report")
    assert main(["replay", str(viewed_case), "--no-ros", "--report", str(report)]) == 0
    return list(csv.DictReader((report / "margin.csv").open()))


def go_to(page, frame, frames=40):
    """Click on the timeline at ``frame``; frames are 50 ms apart."""
    if frame == frames - 1:
        page.keyboard.press("End")
    else:
        box = page.locator("#timeline").bounding_box()
        across = box["width"] * (frame + 0.4) / (frames - 1)
        place = Position(x=across, y=box["height"] / 2)
        page.locator("#timeline").click(position=place)  # waits while the page is covered
    expect(page.locator("#frame")).to_have_text(str(frame))


def select_camera(page, key, name):
    """Select a camera and wait until it is in use."""
    page.keyboard.press(key)
    expect(page.get_by_role("button", name=name)).to_have_attribute("aria-pressed", "true")


def picture(page):
    """The pixels of the newest picture on the page."""
    number = page.evaluate("trame.state.get('now').number")
    page.wait_for_function("number => Number(document.body.dataset.picture) >= number", arg=number)
    shot = screenshot(page.locator("main.view img"))
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def share_of(pixels, colour):
    """The fraction of pixels that are red, green, or grey and brighter than the background."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    is_colour = {
        "red": (red > 70) & (red > 1.7 * green) & (red > 1.7 * blue),
        "green": (green > 80) & (green > 1.5 * red) & (green > 1.5 * blue),
        "grey": (np.ptp(pixels, axis=-1) < 18) & (red > 70) & (red < 200),
    }[colour]
    return float(is_colour.mean())


def test_page_opens_without_errors_and_without_external_requests(watched):
    expect(watched.page.locator("#state-label")).to_be_visible()
    watched.page.keyboard.press(" ")
    watched.page.wait_for_function("trame.state.get('now').frame > 3")
    assert watched.requests
    assert watched.external_requests() == []
    assert watched.errors == []


def test_replay_plays_and_pauses(page):
    page.keyboard.press(" ")
    page.wait_for_function("trame.state.get('now').frame > 5")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    page.keyboard.press(" ")
    expect(page.locator(".paused")).to_be_visible()
    frame = page.locator("#frame").inner_text()
    page.wait_for_timeout(200)
    assert page.locator("#frame").inner_text() == frame


def test_seek_shows_the_row_of_margin_csv(page, rows):
    for frame in (0, 13, BREACH_FRAME, 39, LOST[0], 26, 1):
        go_to(page, frame)
        row = rows[frame]
        shown = page.evaluate("trame.state.get('now')")
        assert shown["state"] == row["state"]
        if row["state"] == "UNKNOWN":
            assert shown["distance"] == "\N{EN DASH}"
        else:
            written = f"{float(row['signed_distance_mm']):.1f}"
            assert shown["distance"] == written.replace("-", MINUS)
        expect(page.locator("#distance")).to_have_text(shown["distance"])


def test_steps_move_by_one_frame_within_the_recording(page):
    go_to(page, 20)
    page.keyboard.press("ArrowRight")
    expect(page.locator("#frame")).to_have_text("21")
    page.get_by_role("button", name="One frame back").click()
    expect(page.locator("#frame")).to_have_text("20")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#frame")).to_have_text("39")


def test_tumor_is_red_in_a_breach_green_when_clear_and_grey_in_a_dropout(page):
    select_camera(page, "2", "Close-up")
    go_to(page, 0)
    clear = picture(page)
    go_to(page, BREACH_FRAME)
    expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
    inside = picture(page)
    go_to(page, LOST[0])
    expect(page.locator("#state-label")).to_have_text("UNKNOWN")
    assert page.locator("#why").inner_text() == "the tracker reports a pose as invalid"
    lost = picture(page)
    assert share_of(clear, "green") > 0.05 > 0.002 > share_of(clear, "red")
    assert share_of(inside, "red") > 0.05 > 0.002 > share_of(inside, "green")
    assert share_of(lost, "grey") > 0.05
    assert share_of(lost, "red") < 0.002 > share_of(lost, "green")


def test_banner_has_color_symbol_and_label_of_the_state(page):
    expected = {0: "CLEAR", BREACH_FRAME: "IN TUMOUR", LOST[0]: "UNKNOWN"}
    colours = {}
    for frame, label in expected.items():
        go_to(page, frame)
        banner = page.get_by_role("status")
        expect(banner).to_contain_text(label)
        code = banner.evaluate("element => getComputedStyle(element).backgroundColor")
        colours[label] = [int(part) for part in code[4:-1].split(",")]
        (state,) = (state for state in MarginState if state.display.label == label)
        assert colours[label] == [round(255 * part) for part in state.color]
        expect(banner).to_contain_text(state.display.symbol)
    green, red, grey = colours["CLEAR"], colours["IN TUMOUR"], colours["UNKNOWN"]
    assert green[1] > 2 * max(green[0], green[2])
    assert red[0] > 2 * max(red[1], red[2])
    assert len(set(grey)) == 1


def test_lamp_of_a_lost_tool_is_missing(page):
    go_to(page, LOST[1])
    lamp = page.locator(".lamps li", has_text="RodToTracker")
    expect(lamp).to_contain_text("missing")
    expect(page.locator(".lamps li", has_text="NeedleToTracker")).to_contain_text("valid")


def test_alarm_rings_in_a_breach_and_can_be_muted(page):
    go_to(page, 0)
    body = page.locator("body")
    expect(body).to_have_attribute("data-sound", "on")
    before = int(body.get_attribute("data-inside-rung") or 0)
    go_to(page, BREACH_FRAME)
    page.wait_for_function("n => Number(document.body.dataset.insideRung) > n + 1", arg=before)
    tones = int(body.get_attribute("data-tones") or 0)
    assert tones > 0
    page.keyboard.down("M")  # with caps lock, and held down
    page.keyboard.down("M")
    page.keyboard.up("M")
    expect(body).to_have_attribute("data-sound", "muted")
    expect(page.locator("#sound")).to_have_attribute("aria-pressed", "true")
    tones = int(body.get_attribute("data-tones"))
    rung = int(body.get_attribute("data-inside-rung"))
    page.wait_for_function("n => Number(document.body.dataset.insideRung) > n + 1", arg=rung)
    assert int(body.get_attribute("data-tones")) == tones
    page.locator("#sound").click()
    expect(body).to_have_attribute("data-sound", "on")
    go_to(page, 0)


def test_low_tone_rings_when_a_known_state_becomes_unknown(page):
    go_to(page, 0)
    expect(page.locator("#state-label")).to_have_text("CLEAR")
    body = page.locator("body")
    rung = int(body.get_attribute("data-unknown-rung") or 0)
    go_to(page, LOST[0])
    page.wait_for_function("n => Number(document.body.dataset.unknownRung) > n + 1", arg=rung)
    go_to(page, 0)
    expect(page.locator("#state-label")).to_have_text("CLEAR")
    assert page.locator("body").get_attribute("data-sound") == "on"


# A test double of a browser that blocks sound until the page is clicked. Chromium itself counts the
# evaluations of a test as clicks.
BLOCKED_SOUND = """
    const context = AudioContext;
    let clicked = false;
    window.addEventListener("click", () => { clicked = true; }, true);
    window.AudioContext = class extends context {
        get state() { return clicked ? super.state : "suspended"; }
    };
"""


def test_blocked_sound_is_shown_until_the_page_is_clicked(browser, server):
    context = browser.new_context()
    watched = Watched(context.new_page(), server.host)
    watched.page.add_init_script(BLOCKED_SOUND)
    page = watched.open(server.url)
    body = page.locator("body")
    expect(body).to_have_attribute("data-sound", "blocked")
    expect(page.locator("#sound")).to_contain_text("blocked")
    page.locator("#sound").click()
    expect(body).to_have_attribute("data-sound", "on")
    context.close()


def test_tumor_can_be_hidden(page):
    select_camera(page, "2", "Close-up")
    go_to(page, 0)
    assert share_of(picture(page), "green") > 0.05
    page.get_by_label("Tumour", exact=True).uncheck()
    page.wait_for_function("trame.state.get('parts')[0].visible === false")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#frame")).to_have_text("1")
    assert share_of(picture(page), "green") < 0.02
    page.get_by_label("Tumour", exact=True).check()


def test_camera_is_selected_by_key_and_button_and_released_by_the_mouse(page):
    page.keyboard.press("4")
    bullseye = page.get_by_role("button", name="Bullseye")
    expect(bullseye).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".rings")).to_be_visible()
    page.get_by_role("button", name="Overview").click()
    expect(bullseye).to_have_attribute("aria-pressed", "false")
    box = page.locator("main.view").bounding_box()
    wait_until_uncovered(page)
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 360, box["y"] + 220, steps=4)
    page.mouse.up()
    expect(page.get_by_role("button", name="Overview")).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("1")


def saved_picture(page):
    """Banner and picture of a screenshot."""
    with page.expect_download() as waiting:
        page.locator("#screenshot").click()
    shot = Image.open(waiting.value.path())
    assert shot.format == "PNG"
    height = shot.height - round(page.locator("main.view").bounding_box()["height"])
    return (
        shot.crop((0, 0, shot.width, height)),
        shot.crop((0, height, shot.width, shot.height)),
    )


def test_stopped_session_has_a_grey_plot_and_a_label(page):
    """Sets the value that `LiveTimeline` sends; the next picture of this replay clears it."""
    stopped = page.get_by_text("STOPPED")
    expect(stopped).to_be_hidden()
    # Repeated: a late update of the server may overwrite the value.
    page.wait_for_function(
        """() => {
            trame.state.set('now', {...trame.state.get('now'), stopped: true});
            return document.body.innerText.includes('STOPPED') &&
                getComputedStyle(document.querySelector('#timeline')).filter === 'grayscale(1)';
        }"""
    )
    page.keyboard.press("ArrowRight")
    expect(stopped).to_be_hidden()


def test_screenshot_has_the_size_of_the_view(page):
    go_to(page, 0)
    banner, shot = saved_picture(page)
    view = page.locator("main.view").bounding_box()
    assert abs(shot.width - view["width"]) <= 1
    assert 20 <= banner.height <= 80
    assert len(np.unique(np.asarray(shot))) > 20


def test_screenshot_has_color_and_text_of_the_state(page):
    """A saved file needs the state as text: it is viewed without the page."""
    select_camera(page, "2", "Close-up")
    masks = set()
    for frame, state in ((0, "NEGATIVE"), (BREACH_FRAME, "POSITIVE"), (LOST[0], "UNKNOWN")):
        go_to(page, frame)
        banner, _ = saved_picture(page)
        pixels = np.asarray(banner.convert("RGB")).reshape(-1, 3)
        colors, counts = np.unique(pixels, axis=0, return_counts=True)
        expected = np.round(255.0 * np.array(MarginState[state].color))
        assert np.abs(colors[counts.argmax()] - expected).max() <= 1
        letters = np.abs(pixels - expected).max(axis=1) > 60
        assert letters.mean() > 0.005  # the text
        masks.add(letters.tobytes())
    assert len(masks) == 3


def test_picture_of_a_huge_page_has_a_limited_size(page):
    page.set_viewport_size({"width": 5000, "height": 3000})
    page.wait_for_function(
        "() => { const i = document.querySelector('main.view img');"
        " return i.naturalWidth > 1500 && i.naturalWidth * i.naturalHeight <= 1920 * 1200; }"
    )


def test_report_can_be_downloaded(page):
    page.locator("#export summary").click()
    with page.expect_download() as waiting:
        page.locator("#export-report-html").click()
    page.locator("#export summary").click()
    text = Path(waiting.value.path()).read_text()
    assert waiting.value.suggested_filename == "report.html"
    assert "small: margin report" in text
    assert text.count("data:image/png;base64") == 2


def test_all_controls_are_reachable_by_keyboard_and_have_a_name(page):
    names = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        names.add(
            page.evaluate(
                "() => { const e = document.activeElement; return e.ariaLabel || "
                "e.labels?.[0]?.textContent.trim() || e.textContent.trim(); }"
            )
        )
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none" or page.evaluate("document.activeElement === document.body")
    assert {"Play", "One frame back", "One frame on", "Rate", "Time in the recording"} <= names
    assert {"Tumour", "Opacity of Tumour", "Export", "Screenshot"} <= names


def test_sections_do_not_overlap_and_are_not_cut_off(page):
    for width, height in ((1280, 720), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(150)
        boxes = page.evaluate(
            "() => [...document.querySelectorAll('.bar, .view, .side > *, .time')]"
            ".map(e => { const b = e.getBoundingClientRect();"
            " return [b.left, b.top, b.right, b.bottom, e.scrollWidth - e.clientWidth]; })"
        )
        for left, top, right, bottom, hidden in boxes:
            assert -0.5 <= left < right <= width + 0.5
            assert -0.5 <= top < bottom <= height + 0.5
            assert hidden <= 1
        for n, (a, b, c, d, _) in enumerate(boxes):
            for e, f, g, h, _ in boxes[:n]:
                assert min(c, g) - max(a, e) <= 1.5 or min(d, h) - max(b, f) <= 1.5


@pytest.mark.parametrize(
    ("width", "height"),
    [(390, 844), (844, 390), (768, 1024), (640, 360)],
    ids=["phone", "phone on its side", "tablet", "enlarged twice"],
)
def test_small_page_shows_picture_state_and_distance(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_timeout(150)
    boxes = page.evaluate(
        """() => Object.fromEntries(['.view', '#state-label', '#distance', '#play', '#timeline',
            '#sound', '#export', '.note', '.looks button:last-child'].map(name => {
          const box = document.querySelector(name).getBoundingClientRect();
          const visible = [0.03, 0.5, 0.97].every(share => document.elementFromPoint(
            box.left + share * box.width, box.top + 0.5 * box.height)?.closest(name));
          const inside = box.top >= 0 && box.bottom <= innerHeight;
          return [name, {width: box.width, height: box.height, visible: visible && inside}];
        }))"""
    )
    assert [name for name, box in boxes.items() if not box["visible"]] == []
    view = boxes[".view"]
    assert view["width"] * view["height"] > 0.25 * width * height


def test_many_reasons_move_the_distance_down(page):
    page.set_viewport_size({"width": 1024, "height": 600})
    page.evaluate("document.querySelector('#why').textContent = 'a pose is stale; '.repeat(12)")
    assert page.evaluate(
        "() => { const e = document.querySelector('.state');"
        " return e.scrollHeight <= e.clientHeight; }"
    )


def test_long_case_name_keeps_the_height_of_the_bar(page):
    def bar():
        return page.locator(".bar").bounding_box()["height"]

    usual = bar()
    page.evaluate("document.querySelector('.case').textContent = 'a lumpectomy '.repeat(40)")
    assert bar() == usual
    page.reload()
    page.wait_for_selector("body:not([data-lost]) #state-label")
