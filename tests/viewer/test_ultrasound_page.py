"""Ultrasound images and cuts of a volume on the page: pixels, covers, freeze, choice of a plane."""

import re
from base64 import b64decode

import nibabel
import numpy as np
import pytest
from playwright.sync_api import expect

from app.viewer.image_cuts import SIDE
from tests.case.images.sequences import some_pixels
from tests.case.images.ultrasound_case import COLUMNS, LOST, ROWS, write_ultrasound_case
from tests.cli.small_case import FRAMES
from tests.viewer.conftest import watching
from tests.viewer.page_actions import show_frame

pytestmark = pytest.mark.long

KINDS = ["Ultrasound", "Axial", "Sagittal", "Coronal", "Along the tool"]
OUTLINE = re.compile(r"^M[\d.]+ [\d.]+L")
_PIXELS = """async () => {
  const image = document.querySelector("#us-image image");
  const bitmap = new Image();
  bitmap.src = image.getAttribute("href");
  await bitmap.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [bitmap.naturalWidth, bitmap.naturalHeight];
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let grey = "";  // as text: a list of as many numbers takes seconds to receive
  for (let index = 0; index < data.length; index += 4) grey += String.fromCharCode(data[index]);
  return btoa(grey);
}"""


def pixels_of(page, rows, columns):
    """Grey values (rows, columns) of the image on the page."""
    return np.frombuffer(b64decode(page.evaluate(_PIXELS)), np.uint8).reshape(rows, columns)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return write_ultrasound_case(tmp_path_factory.mktemp("ultrasound") / "case")


@pytest.fixture(scope="module")
def server(serve, case):
    return serve(str(case))


def test_page_shows_the_image_of_the_frame_and_covers_it_while_none_is_current(page, watched):
    part = page.locator("#ultrasound > div")
    show_frame(page, 5)
    expect(part).to_have_attribute("data-image", "5")
    expect(part).to_have_attribute("data-problem", "false")
    expect(page.locator("#us-time")).to_have_text("0.2 s")
    expect(page.locator("path.us-tumor")).to_have_attribute("d", OUTLINE)
    expected = some_pixels(FRAMES, ROWS, COLUMNS)[5]
    np.testing.assert_array_equal(pixels_of(page, ROWS, COLUMNS), expected)
    show_frame(page, LOST)
    expect(part).to_have_attribute("data-problem", "true")
    expect(page.locator("#us-problem")).to_have_text(
        "NO CURRENT IMAGE: image 9: tracker -> probe is OUT_OF_VIEW"
    )
    expect(page.locator("#us-image")).to_be_hidden()
    expect(page.locator("#us-kinds")).to_be_hidden()  # there is one kind of images
    assert not watched.external_requests()
    assert not watched.errors


def test_frozen_image_says_so_and_follows_again(page):
    part = page.locator("#ultrasound > div")
    show_frame(page, 3)
    expect(part).to_have_attribute("data-image", "3")
    page.click("#us-freeze")
    expect(page.locator("#us-frozen")).to_have_text("FROZEN: not current")
    show_frame(page, 4)
    expect(part).to_have_attribute("data-image", "3")
    page.click("#us-freeze")
    expect(page.locator("#us-frozen")).to_be_hidden()
    expect(part).to_have_attribute("data-image", "4")
    page.locator("#us-brightness").fill("2")
    expect(page.locator("#us-image image")).to_have_css("filter", "brightness(2)")


def write_scan(path):
    """A NIfTI file with the value 2 r + 3 a + 5 s at each place, in 240 mm around the origin."""
    r, a, s = np.meshgrid(*[np.arange(61) * 4.0 - 120.0] * 3, indexing="ij")
    matrix = np.diag([4.0, 4.0, 4.0, 1.0])
    matrix[:3, 3] = -120.0
    nibabel.save(nibabel.Nifti1Image((2 * r + 3 * a + 5 * s).astype(np.float32), matrix), path)
    return path


def test_chosen_plane_shows_the_volume_at_the_tip_with_the_outlines(browser, serve, case, tmp_path):
    served = serve(str(case), "--volume", str(write_scan(tmp_path / "scan.nii.gz")))
    with watching(browser, served) as watched:
        page, part = watched.page, watched.page.locator("#ultrasound > div")
        show_frame(page, 5)
        choice = page.locator("#us-kinds select")
        expect(choice.locator("option")).to_have_text(KINDS)
        expect(part).to_have_attribute("data-image", "5")
        choice.select_option("coronal")
        expect(part).to_have_attribute("data-image", re.compile("^-"))
        expect(part).to_have_attribute("data-problem", "false")
        expect(page.locator("#us-kind")).to_have_text("Cut: coronal")
        expect(page.locator(".us-edges text")).to_have_text(["R", "L", "S", "I"])
        expect(page.locator("#us-tip")).to_have_text("Tip in the plane")
        expect(page.locator("path.us-tumor")).to_have_attribute("d", OUTLINE)
        shown = pixels_of(page, SIDE, SIDE).astype(float)
        rows, columns = np.nonzero((shown > 0) & (shown < 255))
        design = np.column_stack([columns, rows, np.ones(len(rows))])
        (across, down, _), *_ = np.linalg.lstsq(design, shown[rows, columns], rcond=None)
        # Columns go to the left and rows down, where the values fall by 2 and 5 per mm.
        assert down < 0.0
        assert across / down == pytest.approx(2 / 5, rel=0.01)
        choice.select_option("ultrasound")
        expect(part).to_have_attribute("data-image", "5")
        assert not watched.external_requests()
        assert not watched.errors
