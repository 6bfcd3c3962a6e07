"""The plot of a report in Chromium: zoom, values at the cursor, paper, and no script."""

import re
from dataclasses import replace
from itertools import pairwise

import pytest
from playwright.sync_api import expect

from tests.page_rules import violations
from tests.report.conftest import write
from tests.report.opened_page import opened
from tests.report.test_cohort_html import page as cohort_page
from tests.report.test_cohort_html import rows as cohort_rows

pytestmark = pytest.mark.long

DISTANCES = [12.0] * 100 + [-2.0] * 10 + [12.0] * 100


@pytest.fixture(scope="module")
def report(tmp_path_factory, record_of):
    folder = tmp_path_factory.mktemp("report")
    write(folder, record_of(DISTANCES), margin_plot=None)
    return (folder / "report.html").as_uri()


def test_plot_zooms_and_shows_values(browser, report):
    page = browser.new_page()
    problems, requests = opened(page, report)
    figure = page.locator("figure.plot")
    expect(figure.locator(".u-over")).to_be_visible()
    expect(figure.locator(".static")).to_be_hidden()
    figure.get_by_role("button", name="breach 1").click()
    area = figure.locator(".u-over").bounding_box()
    page.mouse.move(area["x"] + 0.5 * area["width"], area["y"] + 20)
    legend = figure.locator(".u-legend")
    expect(legend).to_contain_text("-2.00 mm")
    expect(legend).to_contain_text("POSITIVE")
    page.mouse.wheel(0, -200)
    figure.get_by_role("button", name="whole time").click()
    page.mouse.move(area["x"] + 0.1 * area["width"], area["y"] + 20)
    expect(legend).to_contain_text(re.compile("12.00 mm"))
    page.emulate_media(media="print")
    expect(figure.locator(".static")).to_be_visible()
    expect(figure.locator(".chart")).to_be_hidden()
    assert problems == []
    assert [url for url in requests if not url.startswith("data:")] == [report]
    page.close()


_RECORD_TEXTS = """
window.texts = new Map();
const fill = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  const { actualBoundingBoxLeft, actualBoundingBoxRight, actualBoundingBoxAscent,
          actualBoundingBoxDescent } = this.measureText(text);
  window.texts.set(text, [x - actualBoundingBoxLeft, y - actualBoundingBoxAscent,
                          x + actualBoundingBoxRight, y + actualBoundingBoxDescent]);
  return fill.call(this, text, x, y);
};
"""


@pytest.mark.parametrize(
    ("stop_mm", "warn_mm", "lowest_mm"),
    [(1.0, 5.0, -4.9), (1.0, 1.2, -30.0), (0.1, 0.15, -40.0), (2.0, 6.0, -300.0), (5.0, 5.1, 1.0)],
)
def test_names_of_close_margins_do_not_overlap(
    browser, tmp_path, record_of, margins, stop_mm, warn_mm, lowest_mm
):
    distances = [20.0] * 20 + [lowest_mm] * 20 + [20.0] * 20
    close = replace(margins, stop_mm=stop_mm, warn_mm=warn_mm)
    record = record_of(distances, margins=close)
    write(tmp_path, record)
    page = browser.new_page()
    page.add_init_script(_RECORD_TEXTS)
    page.goto((tmp_path / "report.html").as_uri())
    expect(page.locator("figure.plot .u-over")).to_be_visible()
    names = [f"warn {warn_mm:g}", f"stop {stop_mm:g}", "surface"]
    page.wait_for_function("(names) => names.every((name) => texts.has(name))", arg=names)
    boxes = [page.evaluate("(name) => texts.get(name)", name) for name in names]
    for above, below in pairwise(boxes):
        assert above[3] <= below[1]
    height = page.evaluate("document.querySelector('figure.plot canvas').height")
    assert boxes[0][1] > 0 and boxes[-1][3] < height
    page.close()


@pytest.mark.parametrize("width", [390, 1920])
def test_pages_have_no_violations(browser, report, tmp_path, width):
    cohort = tmp_path / "cohort.html"
    cohort.write_text(cohort_page(cohort_rows())[0])
    page = browser.new_page(viewport={"width": width, "height": 844})
    for address in (report, cohort.as_uri()):
        page.goto(address)
        assert violations(page) == []
    page.close()


def test_page_without_scripts_shows_the_picture(browser, report):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(report)
    expect(page.locator("figure.plot .static img")).to_be_visible()
    expect(page.locator("figure.plot .chart")).to_be_hidden()
    context.close()
