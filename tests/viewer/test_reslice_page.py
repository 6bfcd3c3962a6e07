"""Cuts of a volume on the page: their pixels, the choice of the plane, and who may choose."""

import re

import nibabel
import numpy as np
import pytest
from playwright.sync_api import expect

from app.viewer.steps.reslice import SIDE
from tests.case.images.ultrasound_case import write_ultrasound_case
from tests.viewer.conftest import watching
from tests.viewer.test_ultrasound_page import PIXELS_OF, go_to

KINDS = ["Ultrasound", "Axial", "Sagittal", "Coronal", "Along the tool"]


def write_scan(path):
    """A NIfTI file with the value 2 r + 3 a + 5 s at each place, in 240 mm around the origin."""
    r, a, s = np.meshgrid(*[np.arange(61) * 4.0 - 120.0] * 3, indexing="ij")
    matrix = np.diag([4.0, 4.0, 4.0, 1.0])
    matrix[:3, 3] = -120.0
    nibabel.save(nibabel.Nifti1Image((2 * r + 3 * a + 5 * s).astype(np.float32), matrix), path)
    return path


@pytest.fixture(scope="module")
def watched(browser, serve, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reslice")
    case = write_ultrasound_case(folder / "case")
    served = serve(str(case), "--volume", str(write_scan(folder / "scan.nii.gz")))
    with watching(browser, served) as found:
        yield found


def test_chosen_plane_shows_the_volume_at_the_tip_with_the_outlines(watched):
    page, part = watched.page, watched.page.locator("#ultrasound > div")
    go_to(page, 5)
    choice = page.locator("#us-kinds select")
    expect(choice.locator("option")).to_have_text(KINDS)
    expect(part).to_have_attribute("data-image", "5")
    choice.select_option("coronal")
    expect(part).to_have_attribute("data-image", re.compile("^-"))
    expect(part).to_have_attribute("data-problem", "false")
    expect(page.locator("#us-kind")).to_have_text("Cut: coronal")
    expect(page.locator(".us-edges text")).to_have_text(["R", "L", "S", "I"])
    expect(page.locator("#us-tip")).to_have_text("Tip in the plane")
    expect(page.locator("path.us-tumor")).to_have_attribute("d", re.compile(r"^M[\d.]+ [\d.]+L"))
    shown = np.array(page.evaluate(PIXELS_OF)).reshape(SIDE, SIDE, 4)[..., 0].astype(float)
    rows, columns = np.nonzero((shown > 0) & (shown < 255))
    design = np.column_stack([columns, rows, np.ones(len(rows))])
    (across, down, _), *_ = np.linalg.lstsq(design, shown[rows, columns], rcond=None)
    # Columns go to the left and rows down, where the values fall by 2 and 5 per mm.
    assert down < 0.0
    assert across / down == pytest.approx(2 / 5, rel=0.01)
    assert not watched.external_requests()
    assert not watched.errors
    choice.select_option("ultrasound")
    expect(part).to_have_attribute("data-image", "5")
