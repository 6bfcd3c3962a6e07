"""The page of an approach in Chromium: the robot moves with the slider, the structures do not."""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from app.report.approach_page import approach_page
from tests.page_rules import violations
from tests.planning.test_preview import preview as preview
from tests.planning.test_preview import robot as robot
from tests.planning.test_preview import structures as structures
from tests.report.opened_page import opened
from tests.viewer.pictures import PICTURES, use_palette

pytestmark = pytest.mark.long

_SUM = """
async () => {
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const canvas = document.querySelector("figure.motion canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  const found = { blue: [0, 0, 0], red: [0, 0, 0] };
  for (let at = 0; at < data.length; at += 4) {
    const [r, g, b] = data.subarray(at, at + 3);
    const color = r > 2 * b ? found.red : b > 2 * r && r < 70 ? found.blue : null;
    if (!color) continue;
    color[0] += 1;
    color[1] += (at / 4) % canvas.width;
    color[2] += Math.floor(at / 4 / canvas.width);
  }
  return found;
}
"""
"""Number of pixels of robot and structures, and sums of their places."""


@pytest.mark.parametrize("width", [390, 1280])
def test_slider_moves_the_robot_and_not_the_structures(browser, preview, tmp_path, width):
    path = tmp_path / "approach.html"
    path.write_text(approach_page(preview, "touch"))
    page = browser.new_page(viewport={"width": width, "height": 844})
    problems, requests = opened(page, path.as_uri())
    figure = page.locator("figure.motion")
    reading, slider = figure.locator(".reading"), figure.locator("input")
    expect(reading).not_to_be_empty()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert violations(page) == []
    first = page.evaluate(_SUM)
    assert first["blue"][0] > 500 and first["red"][0] > 500
    for number in (20, len(preview.samples) - 1):
        slider.fill(str(number))
        nearest = int(preview.distances_mm[number].argmin())
        expect(reading).to_have_text(
            f"{preview.times_s[number]:.2f} s: {preview.structures[nearest][0]} is nearest, "
            f"{preview.distances_mm[number, nearest]:.2f} mm"
        )
        if PICTURES and (width, number) == (1280, 20):
            figure.screenshot(path=Path(PICTURES) / "approach_page.png")
            use_palette("approach_page")
    last = page.evaluate(_SUM)
    assert np.abs(np.subtract(last["blue"], first["blue"])[1:]).max() > 1000
    # The robot may hide a part of the structures.
    assert last["red"][0] == pytest.approx(first["red"][0], rel=0.2)
    figure.get_by_role("button", name="play").click()
    expect(reading).to_have_text(re.compile(rf"^{preview.times_s[-1]:.2f} s"))
    expect(figure.get_by_role("button", name="play")).to_be_visible()
    figure.locator("canvas").focus()
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(_SUM) != last
    page.emulate_media(media="print")
    expect(figure.locator(".static img")).to_be_visible()
    expect(figure.locator("canvas")).to_be_hidden()
    assert problems == []
    assert [url for url in requests if not url.startswith("data:")] == [path.as_uri()]
    page.close()
