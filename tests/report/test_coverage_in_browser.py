"""The turnable coverage in Chromium: picture and values against an independent projection."""

import json
import re

import numpy as np
import pytest
from playwright.sync_api import expect

from app.report import analysis_page
from tests.page_rules import violations
from tests.report.conftest import write
from tests.report.opened_page import opened
from tests.report.projected_coverage import Projection, View

pytestmark = pytest.mark.long

SIZES = {"phone": (390, 844), "laptop": (1280, 720), "desktop": (1920, 1080)}
_PIXELS = """
async (points) => {
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const canvas = document.querySelector("figure.coverage canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  return points.map(([x, y]) => [...context.getImageData(x, y, 1, 1).data].slice(0, 3));
}
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory, analysed):
    path = tmp_path_factory.mktemp("coverage") / "analysis.html"
    path.write_text(analysis_page(analysed, analysed.figures()))
    return path.as_uri()


class Shown:
    """The figure in an open page."""

    def __init__(self, page):
        self.page, self.figure = page, page.locator("figure.coverage")
        self.canvas, self.reading = self.figure.locator("canvas"), self.figure.locator(".reading")
        self.canvas.scroll_into_view_if_needed()
        expect(self.reading).not_to_be_empty()
        box = self.canvas.bounding_box()
        self.left, self.top = box["x"], box["y"]
        document = json.loads(self.figure.locator("script").text_content())
        self.projection = Projection(document, round(box["width"]), round(box["height"]))
        self.start = View(document["start"]["azimuth"], document["start"]["elevation"])

    def at(self, pixel, right=0.0, down=0.0):
        return self.left + pixel[0] + right, self.top + pixel[1] + down

    def check(self, view):
        """Picture and values at many places are those that the projection predicts for ``view``."""
        projection = self.projection
        # Outside of what lies over the surface, which is checked apart.
        over = np.concatenate([projection.letters(view), projection.marks(view)])
        over = np.concatenate([over, projection.middle[None]])
        reach = 0.9 * projection.half * np.linspace(-1.0, 1.0, 31)
        grid = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2) + projection.middle
        pixels = np.floor(grid)
        free = np.linalg.norm(pixels[:, None] - over[None], axis=2).min(axis=1) > 17.0
        pixels = pixels[free]
        around = [[0.5, 0.5], [-0.5, -0.5], [1.5, -0.5], [-0.5, 1.5], [1.5, 1.5]]
        faces = np.stack([projection.seen(pixels + each, view) for each in around], axis=1)
        inside = (faces == faces[:, :1]).all(axis=1)
        pixels, faces = pixels[inside], faces[inside, 0]
        assert (faces >= 0).sum() > 30 and (faces < 0).sum() > 30
        found = np.array(self.page.evaluate(_PIXELS, pixels.astype(int).tolist()))
        paper = np.full(3, 255.0)
        expected = [paper if face < 0 else projection.color(face, view) for face in faces]
        apart = np.abs(found - np.array(expected)).max(axis=1)
        assert (apart <= 3.0).all(), (pixels[apart > 3.0], faces[apart > 3.0])
        on, beside = np.flatnonzero(faces >= 0), np.flatnonzero(faces < 0)
        for index in [*on[:: max(1, len(on) // 12)], beside[len(beside) // 2]]:
            self.page.mouse.move(*self.at(pixels[index] + 0.5))
            expect(self.reading).to_have_text(_ending(projection.texts(faces[index])))

    def check_cross(self, view):
        """The value in the middle, which keys show."""
        (face,) = self.projection.seen([self.projection.middle], view)
        expect(self.reading).to_have_text(_ending(self.projection.texts(face)))


def _ending(texts):
    choices = "|".join(map(re.escape, texts))
    return re.compile(f"^From [a-z ]+: ({choices})(, breach [0-9]+)*$")


@pytest.fixture
def shown(browser, report, request):
    """The figure on a laptop, or at the size that a test is parametrised with."""
    width, height = SIZES[getattr(request, "param", "laptop")]
    context = browser.new_context(viewport={"width": width, "height": height}, has_touch=True)
    page = context.new_page()
    problems, requests = opened(page, report)
    yield Shown(page)
    assert problems == []
    assert [url for url in requests if not url.startswith("data:")] == [report]
    context.close()


ALL_SIZES = pytest.mark.parametrize("shown", SIZES, indirect=True)


@ALL_SIZES
def test_picture_and_values_at_the_start_are_those_of_the_projection(shown):
    assert violations(shown.page) == []
    shown.check(shown.start)
    assert shown.page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_mouse_turns_and_wheel_zooms(shown):
    start, mouse, middle = shown.start, shown.page.mouse, shown.projection.middle
    mouse.move(*shown.at(middle, -40.0, 30.0))
    mouse.down()
    mouse.move(*shown.at(middle), steps=3)
    mouse.move(*shown.at(middle, 60.0, 10.0), steps=4)
    mouse.up()
    mouse.move(*shown.at(middle))
    turned = View(start.azimuth + 50.0, start.elevation - 10.0)
    shown.check(turned)
    mouse.move(*shown.at(middle))
    mouse.wheel(0, -100)
    mouse.wheel(0, -100)
    turned.zoom = 1.25**2
    shown.check(turned)
    shown.figure.get_by_role("button", name="reset").click()
    shown.check(start)


def test_keys_turn_zoom_and_read_at_the_cross(shown):
    start, keyboard = shown.start, shown.page.keyboard
    shown.figure.get_by_role("button", name=re.compile("breach")).last.focus()
    keyboard.press("Tab")
    expect(shown.canvas).to_be_focused()
    for key in ("ArrowLeft",) * 4 + ("ArrowDown",) * 2 + ("+",):
        keyboard.press(key)
    turned = View(start.azimuth - 40.0, start.elevation + 20.0, 1.25)
    shown.check_cross(turned)
    shown.check(turned)
    for key in ("-", "-", "ArrowUp", "ArrowRight"):
        keyboard.press(key)
    turned = View(start.azimuth - 30.0, start.elevation + 10.0)
    shown.check_cross(turned)
    shown.check(turned)
    for _ in range(20):
        keyboard.press("ArrowDown")
    turned.elevation = 90.0
    shown.check_cross(turned)
    shown.check(turned)
    keyboard.press("0")
    shown.check_cross(start)
    shown.check(start)


@pytest.mark.parametrize("shown", ["phone"], indirect=True)
def test_touch_turns_and_two_fingers_zoom(shown):
    start, middle = shown.start, shown.projection.middle
    session = shown.page.context.new_cdp_session(shown.page)

    def touch(kind, *places):
        points = [dict(zip("xy", shown.at(middle, *place), strict=True)) for place in places]
        numbered = [{**point, "id": number} for number, point in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": numbered})

    before = shown.page.evaluate("scrollY")
    touch("touchStart", [0.0, 0.0])
    touch("touchMove", [-30.0, 20.0])
    touch("touchMove", [-60.0, 40.0])
    touch("touchEnd")
    turned = View(start.azimuth - 30.0, start.elevation + 20.0)
    shown.check(turned)
    touch("touchStart", [-30.0, 0.0], [30.0, 0.0])
    touch("touchMove", [-45.0, 0.0], [45.0, 0.0])
    touch("touchEnd")
    turned.zoom = 1.5
    shown.check(turned)
    assert shown.page.evaluate("scrollY") == before


@ALL_SIZES
def test_buttons_show_a_side_and_a_breach(shown):
    figure, document = shown.figure, shown.projection.document
    for side in document["sides"]:
        figure.get_by_role("button", name=f"from {side['word']}", exact=True).click()
        expect(shown.reading).to_have_text(re.compile(f"^From {side['word']}: "))
        shown.check_cross(View(side["azimuth"], side["elevation"]))
    (breach,) = document["breaches"]
    figure.get_by_role("button", name="breach 1").click()
    view = View(breach["azimuth"], breach["elevation"])
    ((x, y),) = shown.projection.marks(view)
    np.testing.assert_allclose((x, y), shown.projection.middle, atol=0.3)
    expect(shown.reading).to_have_text(re.compile(", breach 1$"))
    figure.get_by_role("button", name="zoom in").click()
    view.zoom = 1.25
    shown.check(view)
    shown.page.mouse.move(*shown.at(shown.projection.middle, 4.0, -4.0))
    expect(shown.reading).to_have_text(re.compile(", breach 1$"))


def test_marks_and_letters_are_at_their_places(shown):
    ink = np.array([int(shown.projection.document["ink"][k : k + 2], 16) for k in (1, 3, 5)])

    def is_inked(place, radius, right=0.0):
        steps = np.arange(-radius, radius + 1)
        pixels = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) + np.round(place)
        pixels[:, 0] += right
        found = np.array(shown.page.evaluate(_PIXELS, pixels.astype(int).tolist()))
        return bool((np.abs(found - ink).max(axis=1) < 25).any())

    (breach,) = shown.projection.document["breaches"]
    shown.figure.get_by_role("button", name="breach 1").click()
    view = View(breach["azimuth"], breach["elevation"])
    (place,) = shown.projection.marks(view)
    assert is_inked(place, 2, right=9.0) and is_inked(place, 2, right=-9.0)  # the ring
    view.azimuth += 180.0
    for _ in range(18):
        shown.canvas.press("ArrowRight")
    view.elevation = breach["elevation"]
    (behind,) = shown.projection.marks(view)
    assert not is_inked(behind, 2, right=9.0)
    shown.figure.get_by_role("button", name="from anterior", exact=True).click()
    front = View(0.0, 0.0)
    sides = shown.projection.document["sides"]
    for side, place in zip(sides, shown.projection.letters(front), strict=True):
        assert is_inked(place, 6) == (side["letter"] in "RLSI")
    right, left = shown.projection.letters(front)[:2]
    assert right[0] < left[0]  # the patient's right is on the left of the reader


def test_paper_and_a_browser_without_scripts_show_the_six_views(browser, report, shown):
    expect(shown.figure.locator(".static")).to_be_hidden()
    shown.page.emulate_media(media="print")
    expect(shown.figure.locator(".static svg")).to_be_visible()
    expect(shown.canvas).to_be_hidden()
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(report)
    expect(page.locator("figure.coverage .static svg")).to_be_visible()
    expect(page.locator("figure.coverage canvas")).to_be_hidden()
    context.close()


def test_report_of_a_replay_has_it_too(browser, tmp_path, record_of, analysed):
    record = record_of([6.0, -1.0])
    write(tmp_path, record, analysed=analysed)
    page = browser.new_page()
    page.goto((tmp_path / "report.html").as_uri())
    shown = Shown(page)
    shown.check(shown.start)
    assert violations(page) == []
    page.close()
