"""The ultrasound image on the page: its pixels, when it is covered, freeze and brightness."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.case.images.sequences import some_pixels
from tests.case.images.ultrasound_case import COLUMNS, LOST, ROWS, write_ultrasound_case
from tests.cli.small_case import FRAMES
from tests.viewer.conftest import watching

PIXELS_OF = """async () => {
  const image = document.querySelector("#us-image image");
  const bitmap = new Image();
  bitmap.src = image.getAttribute("href");
  await bitmap.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [bitmap.naturalWidth, bitmap.naturalHeight];
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return Array.from(context.getImageData(0, 0, canvas.width, canvas.height).data);
}"""


@pytest.fixture(scope="module")
def watched(browser, serve, tmp_path_factory):
    case = write_ultrasound_case(tmp_path_factory.mktemp("ultrasound") / "case")
    with watching(browser, serve(str(case))) as found:
        yield found


def go_to(page, frame):
    """Step to ``frame`` from the first one."""
    page.keyboard.press("Home")
    page.wait_for_function("trame.state.get('now').frame === 0")
    for _ in range(frame):
        page.keyboard.press("ArrowRight")
    page.wait_for_function("frame => trame.state.get('now').frame === frame", arg=frame)


def test_page_shows_the_image_of_the_frame_and_covers_it_while_none_is_current(watched):
    page, part = watched.page, watched.page.locator("#ultrasound > div")
    go_to(page, 5)
    expect(part).to_have_attribute("data-image", "5")
    expect(part).to_have_attribute("data-problem", "false")
    expect(page.locator("#us-time")).to_have_text("image 5 at 100.250 s")
    expect(page.locator("path.us-tumor")).to_have_attribute("d", re.compile(r"^M[\d.]+ [\d.]+L"))
    shown = np.array(page.evaluate(PIXELS_OF)).reshape(ROWS, COLUMNS, 4)
    expected = some_pixels(FRAMES, ROWS, COLUMNS)[5]
    np.testing.assert_array_equal(shown[..., 0], expected)
    go_to(page, LOST)
    expect(part).to_have_attribute("data-problem", "true")
    expect(page.locator("#us-problem")).to_have_text(
        "NO CURRENT IMAGE: image 9: tracker -> probe is OUT_OF_VIEW"
    )
    expect(page.locator("#us-image")).to_be_hidden()
    expect(page.locator("#us-kinds")).to_be_hidden()  # there is one kind of images
    assert not watched.external_requests()
    assert not watched.errors


def test_frozen_image_says_so_and_follows_again(watched):
    page, part = watched.page, watched.page.locator("#ultrasound > div")
    go_to(page, 3)
    expect(part).to_have_attribute("data-image", "3")
    page.click("#us-freeze")
    expect(page.locator("#us-frozen")).to_have_text("FROZEN: not current")
    page.locator("#us-freeze").evaluate("button => button.blur()")
    go_to(page, 4)
    expect(part).to_have_attribute("data-image", "3")
    page.click("#us-freeze")
    expect(page.locator("#us-frozen")).to_be_hidden()
    expect(part).to_have_attribute("data-image", "4")
    page.locator("#us-brightness").fill("2")
    expect(page.locator("#us-image image")).to_have_css("filter", "brightness(2)")
    page.locator("#us-brightness").evaluate("slider => slider.blur()")
