"""The whole workflow on the live page, on a simulated operation: from ultrasound to a report."""

import json
import time

import numpy as np
import pytest
import trimesh
from playwright.sync_api import expect
from skimage.filters import gaussian
from skimage.measure import find_contours

from app.case import open_case
from app.files.meshes import load_mesh
from app.synthetic.operation import PLANES
from tests.bridge.live.conftest import start as start
from tests.forking import COMMAND, run_forked
from tests.viewer.conftest import watching
from tests.viewer.page_actions import choose, confirm, download, wait_for, wait_until_uncovered
from tests.viewer.pictures import picture
from tests.viewer.test_contour_page import click, has_points
from tests.viewer.test_ultrasound_page import pixels_of

pytestmark = pytest.mark.long

COUNT_CLICKS = """
addEventListener("pointerdown", (event) => {
  if (event.isTrusted) window.clicks = (window.clicks ?? 0) + 1;
}, true);"""
MAX_CLICKS = 35
"""From the empty page to the finished recording, but those on the outline in the images."""

BORDER_LEVEL = 75.0
CLICKS = 8


@pytest.fixture
def operation(start, tmp_path):
    """The simulated operation, with its folder written."""
    child = start("-m", "app.cli", "simulate", "operation", str(tmp_path / "operation"))
    child.line(lambda line: line.startswith("simulated operation"))
    return child


def reach(operation, phase):
    """Request a phase, and wait until its motion has come to its end."""
    operation.send(phase)
    operation.line(lambda line: line.strip() == phase)


def state_of(page, step):
    """The row of a step of the workflow."""
    return page.locator("#workflow li", has_text=step)


class Clicks:
    """Clicks and seconds of each step of the workflow; pictures and the simulation take time."""

    def __init__(self, page):
        self._page = page
        self._before = (0, time.monotonic())
        self.steps = {}

    def end(self, step):
        """Note what was done since the last call as ``step``."""
        now = (self._page.evaluate("window.clicks ?? 0"), time.monotonic())
        self.steps[step] = (now[0] - self._before[0], round(now[1] - self._before[1]))
        self._before = now


def calibrate(page, operation, kind):
    page.click(f"#calibration-{kind}")
    operation.send(kind)
    verdict = page.locator("#calibration-verdict")
    expect(verdict).to_have_attribute("data-ok", "true")
    expect(page.locator("#calibration-covered")).to_contain_text("8 of 8")
    picture(page, f"workflow_{kind}", "#calibration")
    page.click("#calibration-stop")
    confirm(page, "calibration-use")
    expect(page.locator("#calibration-title")).to_have_text("")


def clicks_on(page):
    """Columns and rows on the lesion's outline, of the pixels that the page shows alone."""
    rows, columns = page.evaluate(
        "() => { const box = document.querySelector('#us-image image');"
        " return [Number(box.getAttribute('height')), Number(box.getAttribute('width'))]; }"
    )
    smooth = gaussian(pixels_of(page, int(rows), int(columns)).astype(float), 3.0)
    lines = [line for line in find_contours(smooth, BORDER_LEVEL) if len(line) > 30]
    if not lines:
        return []
    line = max(lines, key=len)
    chosen = line[np.linspace(0, len(line) - 1, CLICKS, endpoint=False).astype(int)]
    return [(float(column), float(row)) for row, column in chosen]


def click_until_added(page, column, row, count):
    """Click again, as a person would, while the click is refused; return how often."""
    note = "document.querySelector('#contour-note').textContent"
    repeated = 0
    while True:
        page.locator("#us-image").wait_for()  # it is covered while an image is late
        page.evaluate(f"{note} = 'not answered'")
        click(page, column, row)
        wait_for(page, f"{note} !== 'not answered'")
        if not (problem := page.evaluate(note)):
            has_points(page, count)
            return repeated
        print(problem)
        repeated += 1


def contour(page, operation):
    """Click on the outline in the images of every second plane; return the number of points."""
    page.click("#contour-add")
    count, repeated = 0, 0
    for plane in range(0, PLANES, 2):
        reach(operation, f"sweep {plane}")
        # Images of the motion are older than the report of its end.
        now = time.strftime("%H:%M:%S")
        wait_for(page, "document.querySelector('#us-time').textContent.slice(0, 8) > arg", now)
        for column, row in clicks_on(page):
            count += 1
            repeated += click_until_added(page, column, row, count)
        if plane == PLANES // 2:
            picture(page, "workflow_contour", "#ultrasound")
    page.click("#contour-add")
    page.fill("#contour-calibration", "0.5")
    page.press("#contour-calibration", "Tab")
    wait_for(page, "trame.state.get('contour').ready")
    print(f"{count} points, {repeated} clicks repeated")
    return count


def compared(found, true):
    """Dice coefficient and ratio of the volumes, of voxels of 0.5 mm inside each by trimesh."""
    low = np.minimum(found.bounds[0], true.bounds[0]) - 1.0
    high = np.maximum(found.bounds[1], true.bounds[1]) + 1.0
    axes = [np.arange(a, b, 0.5) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside, truly = found.contains(places), true.contains(places)
    dice = 2.0 * np.count_nonzero(inside & truly) / (inside.sum() + truly.sum())
    return float(dice), float(inside.sum() / truly.sum())


@pytest.mark.timeout(1800)
def test_workflow_from_ultrasound_to_the_report(
    browser, serve_live, start_server, operation, tmp_path
):
    cases = ("--cases", str(tmp_path / "cases"))
    live = serve_live(tmp_path / "operation" / "live.yaml", *cases)
    with watching(browser, live, script=COUNT_CLICKS) as watched:
        page, clicks = watched.page, Clicks(watched.page)
        expect(page.locator('input[name="mode"][value="prepare"]')).to_be_checked()
        expect(state_of(page, "connect")).to_have_attribute("data-state", "done")
        page.reload()  # a page begins at the first step that is not done then
        wait_until_uncovered(page)
        expect(page.locator("#step-contour")).to_be_checked()
        expect(state_of(page, "contour")).to_have_attribute("data-state", "not done")
        choose(page, "prepare", "connect")
        picture(page, "workflow_connect", "#workflow")
        clicks.end("connect")
        choose(page, "prepare", "calibrate")
        calibrate(page, operation, "pivot")
        calibrate(page, operation, "spin")
        operation.send("rest")
        clicks.end("calibrate")

        page.click("#workflow .next:visible")
        points = contour(page, operation)
        confirm(page, "contour-use")
        expect(state_of(page, "contour")).to_have_attribute("data-state", "done")
        expect(page.locator("#state-label")).to_have_text("HOLD")
        expect(page.locator("#beside")).to_contain_text("margin")
        clicks.end("contour")

        choose(page, "prepare", "register")
        page.click("#registration-start")
        reach(operation, "touch")
        verdict = page.locator("#registration-verdict")
        expect(verdict).to_have_attribute("data-ok", "true")
        picture(page, "workflow_register", "#registration")
        page.click("#registration-stop")
        confirm(page, "registration-use")
        expect(page.locator("#fre")).to_contain_text("points, FRE")
        clicks.end("register")

        choose(page, "operate")
        picture(page, "workflow_hold", "#state-label")
        confirm(page, "rearm")
        expect(page.locator(".hold")).to_have_count(0)
        page.click("#record summary")
        page.fill("#record-name", "operation")
        page.click("#record-confirm")
        expect(page.locator("#recording-mark")).to_be_visible()
        reach(operation, "approach")
        picture(page, "workflow_navigate", "#state-label")
        reach(operation, "breach")
        expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
        picture(page, "workflow_breach", "#state-label")
        reach(operation, "retreat")
        expect(page.locator("#state-label")).not_to_have_text("IN TUMOUR")
        expect(page.locator("#breaches li")).to_have_count(1)
        confirm(page, "record")
        expect(page.locator("#recording .count")).to_have_text("finished")
        clicks.end("operate")
        assert not watched.external_requests()
        assert not watched.errors
    live.close()
    operation.close()
    print("clicks and seconds", clicks.steps)
    assert sum(count for count, _ in clicks.steps.values()) - points <= MAX_CLICKS

    folder = tmp_path / "cases" / "operation"
    accepted = open_case(folder).tumor_mesh()
    true = load_mesh(tmp_path / "operation/truth/tumor.stl", units="mm", frame="tumor")
    dice, ratio = compared(
        trimesh.Trimesh(accepted.vertices_mm, accepted.faces),
        trimesh.Trimesh(true.vertices_mm, true.faces),
    )
    print(f"{points} clicks, Dice {dice:.3f}, volume {100.0 * ratio:.1f} % of the true one")
    assert dice >= 0.90
    assert ratio == pytest.approx(1.0, abs=0.10)
    words = ("-m", "app.cli", "replay", folder, "--no-ros", "--json")
    done = run_forked(*words, modules=COMMAND)
    assert done.returncode == 0, done.stderr
    (breach,) = json.loads(done.stdout)["breaches"]
    print(f"breach of the recorded case: {breach}")
    assert breach["min_signed_distance_mm"] < -1.0

    with watching(browser, start_server(str(folder)), script=COUNT_CLICKS) as watched:
        page, clicks = watched.page, Clicks(watched.page)
        expect(page.locator('input[name="mode"][value="review"]')).to_be_checked()
        expect(page.locator("#breaches li")).to_have_count(1)
        page.locator("#breaches button").first.click()
        expect(page.locator("#state-label")).to_have_text("IN TUMOUR")
        picture(page, "workflow_review", "#state-label")
        page.click("#export summary")
        report = download(page, "#export-report-html").read_text(encoding="utf-8")
        assert f"{breach['min_signed_distance_mm']:.2f} mm" in report
        clicks.end("review")
        print("clicks and seconds", clicks.steps)
        wait_until_uncovered(page)
        assert not watched.errors
