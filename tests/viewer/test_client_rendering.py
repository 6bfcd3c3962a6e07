"""A page that draws the scene itself (``--render client``), beside one that shows pictures of it.

Chromium draws WebGL by software here.
"""

import io
import re
import signal

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from benchmarks.view.chromium import ARGUMENTS, CHROMIUM
from tests.cut_case import write_cut_case
from tests.viewer.conftest import watching
from tests.viewer.page_actions import (
    drag,
    resize,
    screenshot,
    show_frame,
    wait_for,
    wait_until_uncovered,
)
from tests.viewer.viewed_case import BREACH_FRAME, LOST
from tests.waiting import wait_until

pytestmark = pytest.mark.long

FRAMES = {0: "CLEAR", BREACH_FRAME: "IN TUMOUR", LOST[-1]: "UNKNOWN"}
SIZES = (1280, 720), (390, 844)
PICTURE_FITS = """[document.querySelector('main.view img')].every((image) => !image ||
    Math.abs(image.naturalWidth - image.parentElement.clientWidth) <= 2)"""


@pytest.fixture(scope="module")
def webgl(browser):
    """A browser that draws WebGL by software (SwiftShader)."""
    software = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    arguments = [each for each in ARGUMENTS if each != "--disable-gpu"] + software
    launched = browser.browser_type.launch(executable_path=CHROMIUM, args=arguments)
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def client_server(serve, viewed_case):
    return serve(str(viewed_case), "--render", "client")


def show(page, frame, label):
    """Show ``frame``, which has the state ``label``, in the overview of this frame.

    A page's first overview is that of the frame that its replay played when the page had a size.
    """
    show_frame(page, frame)
    expect(page.locator("#state-label")).to_have_text(label)
    page.get_by_role("button", name="Overview").click()
    wait_for(page, PICTURE_FITS)


def picture_of(page):
    """The picture of the page in eighths of its size."""
    content = screenshot(page.locator("main.view"))
    image = Image.open(io.BytesIO(content)).convert("RGB")
    size = (image.width // 8, image.height // 8)
    return np.asarray(image.resize(size, Image.Resampling.BOX)).astype(float)


def look(image):
    """Center (2,) and colour (3,) of the tumour, the largest translucent part, in eighths."""
    bright = image.max(axis=2) > 60.0
    rows, columns = np.nonzero(bright)
    return np.array([rows.mean(), columns.mean()]), image[bright].mean(axis=0)


def differences(pages, max_color):
    """Names of the properties that differ in the pictures of two pages, drawn soon, not at once."""
    first, second = map(picture_of, pages)
    if first.shape != second.shape:
        return ["size"]
    (center, color), (other_center, other_color) = look(first), look(second)
    apart = np.abs(first - second)
    checks = {
        "mean": apart.mean() < 4.0,
        "pixels": (apart.max(axis=2) > 48.0).mean() < 0.02,
        "center": np.abs(center - other_center).max() < 2.0,
        "color": np.abs(color - other_color).max() < max_color,
    }
    return [name for name, same in checks.items() if not same]


def check_same(pages, max_color):
    wait_until(
        lambda: not differences(pages, max_color),
        describe=lambda: f"the pictures differ in {differences(pages, max_color)}",
    )


def test_both_renderings_show_the_same_state_and_pose(webgl, server, client_server):
    with watching(webgl, server) as pictures, watching(webgl, client_server) as drawn:
        pages = (pictures.page, drawn.page)
        for size in SIZES:
            for page in pages:
                resize(page, *size)
            for frame, label in FRAMES.items():
                for page in pages:
                    show(page, frame, label)
                check_same(pages, max_color=25.0)
        assert drawn.errors == []
        assert drawn.external_requests() == []


def test_robot_has_the_same_colours_in_both_renderings(webgl, serve, tmp_path):
    case = write_cut_case(tmp_path / "case", 20.0, 2.5)
    servers = (serve(str(case)), serve(str(case), "--render", "client"))
    with watching(webgl, servers[0]) as pictures, watching(webgl, servers[1]) as drawn:
        pages = (pictures.page, drawn.page)
        for page in pages:
            show(page, 60, "HOLD")
        # The label of the distance is drawn by the server alone.
        check_same(pages, max_color=15.0)


def test_drawing_page_is_covered_while_the_server_is_stopped_and_after_it_was_killed(
    webgl, start_server, viewed_case
):
    server = start_server(str(viewed_case), "--render", "client")
    with watching(webgl, server) as watched:
        expect(watched.page.locator("#lost")).to_be_hidden()
        server.process.send_signal(signal.SIGSTOP)
        expect(watched.page.locator("#lost strong")).to_have_text("CONNECTION LOST")
        expect(watched.page.locator("#lost")).to_be_visible()
        server.process.send_signal(signal.SIGCONT)
        expect(watched.page.locator("#lost")).to_be_hidden()
        server.process.kill()
        expect(watched.page.locator("#lost")).to_be_visible()


def test_page_that_cannot_draw_any_more_is_covered(webgl, client_server):
    with watching(webgl, client_server) as watched:
        page = watched.page
        page.evaluate(
            "document.querySelector('#client-view canvas').getContext('webgl2')"
            ".getExtension('WEBGL_lose_context').loseContext()"
        )
        page.keyboard.press("End")
        expect(page.locator("#lost strong")).to_have_text("PICTURE LATE")


def test_viewer_sees_the_operators_camera_and_sends_no_event(webgl, client_server):
    with watching(webgl, client_server, client_server.view_url) as viewer:
        drag(viewer.page.locator("main.view"), (300, 300), (400, 350))
        wait_until_uncovered(viewer.page)
    assert not re.search("refused", client_server.log.read_text())
