"""Every file that the page of a replay exports is that of ``marginguard replay``."""

import io
import zipfile
from pathlib import Path

import cv2
import pytest
from PIL import Image
from playwright.sync_api import expect

from app.cli.main import main
from tests.page_rules import violations
from tests.viewer.conftest import Watched, watching

WAIT_MS = 120_000
NAMES = ["report.html", "report.pdf", "margin.csv", "scene.mrb", "movie.gif", "movie.mp4"]


@pytest.fixture(scope="module")
def page(browser, serve, viewed_case):
    with watching(browser, serve(str(viewed_case))) as watched:
        yield watched.page
        assert watched.errors == []


def downloaded(page, name):
    with page.expect_download(timeout=WAIT_MS) as waiting:
        page.click(f"#export-{name.replace('.', '-')}")
    assert waiting.value.suggested_filename == name
    return Path(waiting.value.path()).read_bytes()


def test_files_are_those_of_a_replay(page, viewed_case, tmp_path):
    assert main(["replay", str(viewed_case), "--no-ros", "--report", str(tmp_path)]) == 0
    page.click("#export summary")
    assert page.locator("#export a").all_inner_texts() == NAMES
    for width, height in ((1280, 720), (1920, 1080), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert violations(page) == []
        box = page.locator("#export ul").bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= width
    assert downloaded(page, "margin.csv") == (tmp_path / "margin.csv").read_bytes()
    assert downloaded(page, "report.pdf").startswith(b"%PDF-")
    with zipfile.ZipFile(io.BytesIO(downloaded(page, "scene.mrb"))) as bundle:
        assert bundle.testzip() is None
        assert any(name.endswith(".mrml") for name in bundle.namelist())
    with Image.open(io.BytesIO(downloaded(page, "movie.gif"))) as movie:
        assert movie.format == "GIF" and getattr(movie, "n_frames", 1) > 10
    (tmp_path / "movie.mp4").write_bytes(downloaded(page, "movie.mp4"))
    video = cv2.VideoCapture(str(tmp_path / "movie.mp4"))
    # The GIF has one picture for several equal ones.
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 40
    video.release()


def test_viewer_may_export(browser, serve, viewed_case):
    server = serve(str(viewed_case))
    context = browser.new_context(accept_downloads=True)
    page = Watched(context.new_page(), server.host).open(server.view_url)
    page.click("#export summary")
    expect(page.locator("#export a")).to_have_count(len(NAMES))
    assert downloaded(page, "margin.csv").startswith(b"t_s,stamp_ns,")
    context.close()
