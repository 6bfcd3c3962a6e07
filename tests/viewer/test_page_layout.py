"""The page at sizes from a phone to a large screen, and by the keyboard alone."""

import pytest
from playwright.sync_api import expect

from tests.viewer.page_actions import choose, read, resize, wait_until_uncovered

pytestmark = pytest.mark.long

NAME_AND_OUTLINE = """() => {
    const e = document.activeElement;
    return [e.ariaLabel || e.labels?.[0]?.textContent.trim() || e.textContent.trim(), e.outerHTML,
        e === document.body || getComputedStyle(e).outlineStyle !== 'none'];
}"""
CONTROLS = """() => [...document.querySelectorAll('button, a[href], select, input, summary')]
    .filter((each) => each.checkVisibility() && !each.disabled).length"""
PIXEL_MM = 24 * 25.4 / (1920**2 + 1080**2) ** 0.5
"""A pixel of a 24-inch screen of 1920 x 1080."""


def test_every_control_is_reached_by_tab_with_a_name_and_an_outline(page):
    names, elements = set(), ""
    for _ in range(2 * page.evaluate(CONTROLS)):
        page.keyboard.press("Tab")
        name, html, is_outlined = page.evaluate(NAME_AND_OUTLINE)
        assert is_outlined, html
        names.add(name)
        elements += html
    assert {"Play", "One frame back", "One frame on", "Rate", "Time in the recording"} <= names
    assert {"Tumour", "Opacity of Tumour", "Export", "Screenshot"} <= names
    for part in ("Overview", 'id="sound"', 'id="help-button"', 'id="play"', 'id="timeline"'):
        assert part in elements
    for part in ('id="distance-tone"', 'name="TUMOR"', 'type="range"', "<select", "deepest point"):
        assert part in elements


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1920, 1080)])
def test_sections_do_not_overlap_and_are_not_cut_off(page, width, height):
    resize(page, width, height)
    boxes = read(
        page,
        "[...document.querySelectorAll('.bar, .status > *, .view, .looks, .side > *, .time')]"
        ".map(e => { const b = e.getBoundingClientRect();"
        " return [b.left, b.top, b.right, b.bottom, e.scrollWidth - e.clientWidth]; })",
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
    resize(page, width, height)
    boxes = read(
        page,
        """Object.fromEntries(['.view', '#state-label', '#distance', '#play', '#timeline',
            '#sound', '#export', '.note', '.looks button:last-child'].map(name => {
          const box = document.querySelector(name).getBoundingClientRect();
          const visible = [0.03, 0.5, 0.97].every(share => document.elementFromPoint(
            box.left + share * box.width, box.top + 0.5 * box.height)?.closest(name));
          const inside = box.top >= 0 && box.bottom <= innerHeight;
          return [name, {width: box.width, height: box.height, visible: visible && inside}];
        }))""",
    )
    assert [name for name, box in boxes.items() if not box["visible"]] == []
    view = boxes[".view"]
    assert view["width"] * view["height"] > 0.25 * width * height


def test_many_reasons_move_the_distance_down(page):
    resize(page, 1024, 600)
    page.evaluate("document.querySelector('#why').textContent = 'a pose is stale; '.repeat(12)")
    assert page.evaluate(
        "() => { const e = document.querySelector('.state');"
        " return e.scrollHeight <= e.clientHeight; }"
    )


@pytest.mark.parametrize(
    ("selector", "height_px"), [("#state-label", 60), ("#distance", 60), ("#why", 6.0 / PIXEL_MM)]
)
def test_capitals_and_digits_can_be_read_from_afar(page, selector, height_px):
    resize(page, 1920, 1080)
    pixels = page.locator(selector).evaluate(
        """(each) => {
            const context = document.createElement("canvas").getContext("2d");
            const { fontWeight, fontSize, fontFamily } = getComputedStyle(each);
            context.font = `${fontWeight} ${fontSize} ${fontFamily}`;
            return context.measureText("H").actualBoundingBoxAscent;
        }"""
    )
    assert pixels >= height_px


def test_phone_shows_state_then_view(page):
    resize(page, 390, 844)
    tops = [page.locator(each).bounding_box()["y"] for each in (".status", ".view", ".time")]
    assert tops == sorted(tops)


def test_each_mode_shows_its_controls_alone(page):
    shown = {"prepare": ("#workflow",), "operate": ("#directions",), "review": ("#breaches",)}
    hidden = {
        "prepare": ("#breaches", "#export"),
        "operate": ("#workflow",),
        "review": ("#workflow",),
    }
    for mode in shown:
        choose(page, mode)
        for each in shown[mode]:
            expect(page.locator(each)).to_be_visible()
        for each in hidden[mode]:
            expect(page.locator(each)).to_be_hidden()
        for each in ("#state-label", "#distance"):
            expect(page.locator(each)).to_be_visible()
    choose(page, "prepare", "review")  # the last step, not the mode
    expect(page.locator("#workflow")).to_be_visible()
    choose(page, "review")


def test_long_case_name_keeps_the_height_of_the_bar(page):
    def bar():
        return page.locator(".bar").bounding_box()["height"]

    usual = bar()
    page.evaluate("document.querySelector('.case').textContent = 'a lumpectomy '.repeat(40)")
    assert bar() == usual
    page.reload()
    wait_until_uncovered(page)
    expect(page.locator(".case")).not_to_contain_text("lumpectomy")
