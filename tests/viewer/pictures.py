"""Pictures of the page for docs/images, which the tests of the page take if a folder is given."""

import os
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page

from tests.viewer.page_actions import resize, wait_until_uncovered

PICTURES = os.environ.get("MARGINGUARD_PICTURES", "")
"""Folder for the pictures; none by default."""

SIZES = {"1920": (1920, 1080), "1440": (1440, 900), "1280": (1280, 800), "390": (390, 844)}

SHORTEN_PATHS = """() => {
  for (const each of document.querySelectorAll("#recording-folder, #request")) {
    each.textContent = each.textContent.replace(/\\/tmp\\/\\S*\\//g, "");
  }
}"""
"""Folders of this machine do not belong into a picture."""


def picture(page: Page, name: str, part: str) -> None:
    """Take the page at each size with ``part`` in view, and the two files that docs show."""
    if not PICTURES:
        return
    before = page.viewport_size
    assert before is not None
    for size, (width, height) in SIZES.items():
        resize(page, width, height)
        page.locator(".more").evaluate("each => each.scrollTo(0, 0)")
        page.locator(part).scroll_into_view_if_needed()
        page.evaluate(SHORTEN_PATHS)
        page.wait_for_timeout(1500)
        _shoot(page, f"{name}_{size}")
    resize(page, before["width"], before["height"])
    taken = {size: Image.open(Path(PICTURES) / f"{name}_{size}.png") for size in SIZES}
    _save(taken["1280"].resize((960, 600)), name)
    sizes = Image.new("RGB", (1226, 540), "white")
    sizes.paste(taken["1920"].resize((960, 540)), (0, 0))
    sizes.paste(taken["390"].resize((250, 540)), (976, 0))
    _save(sizes, f"{name}_sizes")


def capture(page: Page, name: str) -> None:
    """Take the page as it is, if a folder is given."""
    if PICTURES:
        _shoot(page, name)
        use_palette(name)


def use_palette(name: str) -> None:
    """Save the picture ``name`` with 256 colours, which look the same in a quarter of the size."""
    path = Path(PICTURES) / f"{name}.png"
    colors = Image.open(path).convert("RGB")
    colors.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=2).save(path, optimize=True)


def _shoot(page: Page, name: str) -> None:
    """Take the page without its cover."""
    is_covered = True
    while is_covered:  # on a busy machine pictures are late at a new size
        wait_until_uncovered(page)
        page.screenshot(path=Path(PICTURES) / f"{name}.png")
        is_covered = page.evaluate("'lost' in document.body.dataset")


def _save(image: Image.Image, name: str) -> None:
    image.convert("RGB").save(Path(PICTURES) / f"{name}.jpg", quality=85, optimize=True)
