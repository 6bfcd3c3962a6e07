"""Draws the pictures of docs/images of shipped cases: the page, a cut of a scan, the library.

    MARGINGUARD_PICTURES=FOLDER python -m tests.viewer.draw_pages

With the same variable the tests that call `picture` and `capture` draw the other ones.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import nibabel
import numpy as np
from playwright.sync_api import Page, expect, sync_playwright
from scipy.ndimage import gaussian_filter

from app.case import open_case
from benchmarks.view.chromium import launch
from tests.shipped_case import SHIPPED_CASE
from tests.viewer.page_actions import UNCOVERED
from tests.viewer.pictures import PICTURES, capture, use_palette

SIZE = {"width": 1280, "height": 800}
SIDE_MM, VOXEL_MM = 120.0, 1.0
WAIT_MS = 300_000


@contextmanager
def served(*arguments: str) -> Iterator[Page]:
    """The page of ``marginguard view ARGUMENTS`` in a browser."""
    command = [sys.executable, "-m", "app.cli", "view", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            with sync_playwright() as playwright:
                page = launch(playwright).new_page(viewport=SIZE)
                page.set_default_timeout(WAIT_MS)
                page.goto(server.stdout.readline().strip())
                yield page
        finally:
            server.terminate()


def write_scan(path: Path) -> Path:
    """A made-up scan of soft tissue with a bright tumour at the place of the shipped case's."""
    center = open_case(SHIPPED_CASE).tumor_mesh().centroid_mm
    count = int(SIDE_MM / VOXEL_MM)
    tissue = gaussian_filter(np.random.default_rng(1).normal(size=(count,) * 3), 3.0)
    offsets = (np.arange(count) + 0.5) * VOXEL_MM - 0.5 * SIDE_MM
    across = np.stack(np.meshgrid(*[offsets] * 3, indexing="ij"))
    lesion = np.exp(-((np.linalg.norm(across, axis=0) / 8.0) ** 4))
    matrix = np.diag([VOXEL_MM, VOXEL_MM, VOXEL_MM, 1.0])
    matrix[:3, 3] = center + offsets[0]
    values = 300.0 + 60.0 * tissue / tissue.std() + 120.0 * lesion
    nibabel.save(nibabel.Nifti1Image(values.astype(np.float32), matrix), path)
    return path


def show_breach(page: Page, number: int) -> None:
    """Show the deepest frame of a breach."""
    page.locator(UNCOVERED).wait_for()
    page.locator("#breaches button").nth(number - 1).click()
    expect(page.locator("#state-label")).to_have_text("IN TUMOUR", timeout=WAIT_MS)
    page.locator(".more").evaluate("each => each.scrollTo(0, 0)")
    page.wait_for_timeout(2000)


def main() -> None:
    """Draw them."""
    with served(str(SHIPPED_CASE)) as page:
        show_breach(page, 1)
        capture(page, "view")
    with (
        tempfile.TemporaryDirectory() as folder,
        served(str(SHIPPED_CASE), "--volume", str(write_scan(Path(folder) / "ct.nii.gz"))) as page,
    ):
        show_breach(page, 2)
        page.select_option("#us-kinds select", "Along the tool")
        expect(page.locator("#us-kind")).to_have_text("Cut: along the tool", timeout=WAIT_MS)
        page.wait_for_timeout(2000)
        capture(page, "cut")
    with served(str(SHIPPED_CASE.parent)) as page:
        expect(page.locator("#cases > li")).not_to_have_count(0, timeout=WAIT_MS)
        expect(page.locator("[data-state=computing]")).to_have_count(0, timeout=WAIT_MS)
        page.wait_for_timeout(1000)
        page.screenshot(path=f"{PICTURES}/library.png")
        use_palette("library")


if __name__ == "__main__":
    main()
