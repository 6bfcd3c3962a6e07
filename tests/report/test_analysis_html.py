"""Sections, figures, methods and per-frame table of an analysis, on a part of the shipped case."""

import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest

from app.report import analysis_page
from app.report.analysis_files import FRAME_COLUMNS, FramesTable
from app.report.methods import methods_text, recorded_on
from app.report.page import shaded
from app.report.svg_plots import distance_svg
from app.runtime import StepTiming
from tests.report.conftest import write
from tests.report.test_html import Page
from tests.report.test_time_plot import without_scripts

pytestmark = pytest.mark.slow

_SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def page(analysed):
    return analysis_page(analysed, analysed.figures())


def test_page_has_no_external_resource_and_two_plots(page):
    assert page.count('<figure class="plot"') == 2  # distance and probability
    page = without_scripts(page)
    assert not {"link", "iframe", "object", "base", "img"} & set(Page(page).tags)
    assert Page(page).tags.count("script") == 3  # the data of the plots and of the coverage
    assert not re.search(r"https?:|url\(|@import|href", page)
    assert "<b> case" not in page and "a &lt;b&gt; case" in page


def test_page_has_the_numbers_of_the_analysis(analysed, page):
    (breach,) = analysed.analysis.breaches
    text = Page(page).text
    assert f"{breach.estimate.low_mm:.2f} to {breach.estimate.high_mm:.2f} mm" in text
    assert breach.direction in text
    for side in ("right", "left", "anterior", "posterior", "superior", "inferior"):
        assert any(row[:1] == [side] for row in Page(page).rows)
    assert f"{analysed.analysis.resection.swept.volume_mm3:.1f} mm³" in text
    assert "No specimen: the swept volume does not enclose the tumour." in text
    (stop,) = analysed.analysis.probability.stops
    row = next(row for row in Page(page).rows if row[0] == "stop margin of 2 mm")
    assert row[1] == f"{stop.outcome.probability:.3f}"


def test_the_page_says_which_errors_the_intervals_of_a_depth_contain(analysed, page):
    assert analysed.methods["bias_sigma_mm"] == 0.0
    assert "The intervals contain the jitter of the tracker alone." in Page(page).text
    with_bias = replace(analysed, methods={**analysed.methods, "bias_sigma_mm": 0.5})
    text = Page(analysis_page(with_bias, with_bias.figures())).text
    assert "the jitter of the tracker and an error with a standard deviation of 0.5 mm" in text
    assert "those of the jitter and of a constant error of 0.5 mm." in text


def test_methods_state_versions_hashes_date_and_options(analysed):
    text = methods_text(analysed.analysis, analysed.methods)
    assert "MarginGuard 9.8.7" in text and "manifold3d 3" in text
    for name, sha in analysed.methods["inputs_sha256"].items():
        assert f"{name} (SHA-256 {sha})" in text and len(sha) == 64
    assert "at a date that its clock does not state" in text
    assert "contour 0.7 mm" in text
    assert "last 4 mm of the tool" in text


@pytest.mark.parametrize(
    ("first_ns", "date"),
    [
        (1_700_000_000_123_456_789, "2023-11-14 22:13:20 UTC"),
        (1_000_000_000_000, None),
        (-1, None),
        (2**63, None),
    ],
)
def test_date_is_that_of_a_clock_that_counts_from_1970(first_ns, date):
    assert recorded_on(first_ns) == date


def test_histogram_has_the_time_in_each_bin():
    distances = np.array([-0.5, 0.2, 0.4, 7.5, 80.0, np.nan])
    held = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    root = ElementTree.fromstring(distance_svg(distances, held, 1.0, 5.0))
    titles = [rect.find(f"{_SVG}title").text for rect in root.iter(f"{_SVG}rect")]
    assert titles == ["-1 to 0 mm: 1.00 s", "0 to 1 mm: 5.00 s", "7 to 8 mm: 4.00 s"]
    heights = [float(rect.get("height")) for rect in root.iter(f"{_SVG}rect")]
    assert heights[0] / heights[1] == pytest.approx(0.2, rel=0.01)
    assert "5.0 s farther than 30 mm" in root.find(f"{_SVG}desc").text
    empty = ElementTree.fromstring(distance_svg(distances[5:], held[5:], 1.0, 5.0))
    assert list(empty.iter(f"{_SVG}rect")) == []


def test_coverage_map_has_six_views_with_the_side_of_the_breach_in_the_nearest_class(analysed):
    root = ElementTree.fromstring(analysed.figures()["coverage.svg"])
    groups = {view.find(f"{_SVG}text").text: view for view in root.iter(f"{_SVG}g")}
    views = {text: list(view.iter(f"{_SVG}path")) for text, view in groups.items()}
    assert len(views) == 6
    (breach,) = analysed.analysis.breaches

    def nearest_class(paths):
        shades = {shaded(0, light / 100.0) for light in range(80, 101)}
        return sum(path.get("fill") in shades for path in paths)

    opposite = {"right": "left", "anterior": "posterior", "superior": "inferior"}
    opposite |= {value: key for key, value in opposite.items()}
    assert nearest_class(views[f"from {breach.side}"]) > 3
    assert nearest_class(views[f"from {opposite[breach.side]}"]) == 0
    assert all(len(paths) < 1600 for paths in views.values())
    marked = {text: len(list(view.iter(f"{_SVG}circle"))) for text, view in groups.items()}
    assert marked == {f"from {side}": int(side == breach.side) for side in opposite}


def test_table_of_frames_has_margins_witnesses_and_velocity(prepared, steps):
    table = FramesTable(0.075)
    for step in steps:
        assert table.publish(step, StepTiming())
    found = pq.read_table(io.BytesIO(table.parquet())).to_pydict()
    assert tuple(found) == FRAME_COLUMNS
    assert len(found["t_s"]) == len(steps)
    index = int(np.nanargmin([np.nan if d is None else d for d in found["signed_distance_mm"]]))
    step = steps[index]
    assert found["state"][index] == "POSITIVE"
    assert found["stop_total_mm"][index] == step.decision.margin.total_mm
    assert found["hold"][index] is step.decision.hold
    tool = np.array([found[f"on_tool_{axis}_mm"][index] for axis in "xyz"])
    np.testing.assert_array_equal(tool, step.decision.proximity.on_tool_mm)
    times = np.array(found["t_s"])
    tips = np.array([found[f"tip_{axis}_mm"] for axis in "xyz"], dtype=float).T
    speeds = np.array([found[f"velocity_{axis}_mm_s"] for axis in "xyz"], dtype=float).T
    moving = np.isfinite(speeds).all(axis=1)
    assert moving.mean() > 0.9
    travelled = np.trapezoid(speeds[moving], times[moving], axis=0)
    np.testing.assert_allclose(travelled, tips[moving][-1] - tips[moving][0], atol=0.6)


def test_report_with_an_analysis_has_its_sections(tmp_path, analysed, record_of):
    write(tmp_path, record_of([6.0, -1.0]), analysed=analysed)
    text = (tmp_path / "report.html").read_text()
    assert "<h2>Methods</h2>" in text and "from anterior" in text
    assert not re.search(r"https?:|url\(", without_scripts(text))
    write(tmp_path, record_of([6.0, -1.0]))
    assert "<h2>Methods</h2>" not in (tmp_path / "report.html").read_text()
