"""Every file that the page of a replay exports is that of ``marginguard replay``."""

import io
import zipfile

import cv2
import pytest
from PIL import Image
from playwright.sync_api import expect

from app.report import ReportRow, margin_csv
from tests.page_rules import violations
from tests.viewer.conftest import watching
from tests.viewer.page_actions import download, resize

pytestmark = pytest.mark.long

NAMES = ["report.html", "report.pdf", "margin.csv", "scene.mrb", "movie.gif", "movie.mp4"]


def exported(page, name):
    return download(page, f"#export-{name.replace('.', '-')}", name).read_bytes()


@pytest.mark.timeout(900)
def test_files_are_those_of_a_replay(page, watched, parts, tmp_path):
    rows = [ReportRow.from_step(shown.step) for shown in parts.feed.shown]
    page.click("#export summary")
    expect(page.locator("#export a")).to_have_text(NAMES)
    for width, height in ((1280, 720), (1920, 1080), (390, 844)):
        resize(page, width, height)
        assert violations(page) == []
        box = page.locator("#export ul").bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width
    assert exported(page, "margin.csv") == margin_csv(rows).encode()
    assert exported(page, "report.pdf").startswith(b"%PDF-")
    with zipfile.ZipFile(io.BytesIO(exported(page, "scene.mrb"))) as bundle:
        assert bundle.testzip() is None
        assert any(name.endswith(".mrml") for name in bundle.namelist())
    with Image.open(io.BytesIO(exported(page, "movie.gif"))) as movie:
        assert movie.format == "GIF" and getattr(movie, "n_frames", 1) > 10
    (tmp_path / "movie.mp4").write_bytes(exported(page, "movie.mp4"))
    video = cv2.VideoCapture(str(tmp_path / "movie.mp4"))
    # The GIF has one picture for several equal ones.
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 40
    video.release()
    assert watched.errors == []


def test_viewer_may_export(browser, server):
    with watching(browser, server, server.view_url) as viewer:
        viewer.page.click("#export summary")
        expect(viewer.page.locator("#export a")).to_have_count(len(NAMES))
        assert exported(viewer.page, "margin.csv").startswith(b"t_s,stamp_ns,")
