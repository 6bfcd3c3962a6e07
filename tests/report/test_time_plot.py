import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis.samples import find_breaches
from app.report.page import csp_source, document, figure_scripts
from app.report.svg_plots import _ticks, time_svg
from app.report.time_plot import MAX_POINTS, Line, Series, TimePlot, distance_plot, extremes, spread
from tests.report.conftest import write

DISTANCES = [6.0, 3.125, -1.0, -2.0, None, 6.0]


class Parts(HTMLParser):
    """The content of scripts and styles, and the page's policy."""

    def __init__(self, page):
        super().__init__()
        self.contents, self.policy, self._type = [], "", None
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if values.get("http-equiv") == "Content-Security-Policy":
            self.policy = values["content"]
        self._type = values.get("type", tag) if tag in ("script", "style") else None

    def handle_data(self, data):
        if self._type is not None:
            self.contents.append((self._type, data))
            self._type = None


@pytest.fixture
def plot(rows_of, margins):
    rows = rows_of(DISTANCES)
    return distance_plot(rows, find_breaches(rows, margins.stale_after_ns), margins)


def without_scripts(page):
    """``page`` without what is shipped with this project: uPlot, its style and ours."""
    for script in figure_scripts():
        assert page.count(f"<script>{script}</script>") == 1
        page = page.replace(f"<script>{script}</script>", "")
    return page


def test_data_of_a_page_are_the_distances_states_and_breaches(plot):
    found = json.loads(dict(Parts(plot.html("", "x")).contents)["application/json"])
    assert np.cumsum(found["times_ms"]).tolist() == [0, 20, 40, 60, 80, 100]
    curves = {each["label"]: each["values"] for each in found["series"]}
    assert curves["signed distance"] == [600, 312, -100, -200, None, 600]
    assert curves["lower bound"] == [575, 288, -125, -225, None, 575]
    assert curves["applied stop"] == [150, 150, 150, 150, None, 150]
    states = [(band["from"], band["to"], band["label"].split()[-1]) for band in found["bands"]]
    assert states == [
        (0.0, 0.02, "NEGATIVE"),
        (0.02, 0.04, "WARNING"),
        (0.04, 0.08, "POSITIVE"),
        (0.08, 0.1, "UNKNOWN"),
        (0.1, 0.1, "NEGATIVE"),
    ]
    assert [(mark["from"], mark["to"]) for mark in found["marks"]] == [(0.04, 0.06)]


def test_policy_allows_the_shipped_scripts_and_the_style_alone():
    parts = Parts(
        document("analysis.html", "a page", figures=True, name="x", distance="", sections="")
    )
    scripts = [text for kind, text in parts.contents if kind == "script"]
    assert tuple(scripts) == figure_scripts()
    (style,) = [text for kind, text in parts.contents if kind == "style"]
    directives = dict(each.split(" ", 1) for each in parts.policy.split("; "))
    assert directives["script-src"] == " ".join(map(csp_source, scripts))
    assert directives["style-src"] == csp_source(style)
    assert directives["default-src"] == "'none'" and directives["img-src"] == "data:"
    plain = Parts(document("analysis.html", "a page", name="x", distance="", sections=""))
    assert "script-src 'none'" in plain.policy
    assert [kind for kind, _ in plain.contents] == ["style"]


def test_text_of_the_data_cannot_end_its_element():
    evil = "</script><script>alert(1)</script>"
    plot = TimePlot(np.arange(2.0), (Series(evil, "#000", np.zeros(2)),), evil)
    page = plot.html("", evil)
    assert page.count("</script>") == 1
    (data,) = [text for kind, text in Parts(page).contents if kind == "application/json"]
    assert json.loads(data)["series"][0]["label"] == evil


def test_long_recording_keeps_its_extremes():
    values = np.sin(np.arange(5.0 * MAX_POINTS) / 900.0)
    values[12_345], values[77_777], values[400:2000] = -9.0, 9.0, np.nan
    chosen = extremes(values, MAX_POINTS)
    assert len(chosen) <= MAX_POINTS + 4 and (np.diff(chosen) > 0).all()
    assert {0, 12_345, 77_777, len(values) - 1} <= set(chosen.tolist())
    assert np.isnan(values[chosen]).any()  # the gap stays a gap


def test_static_picture_has_each_run_of_known_values(plot):
    svg = time_svg(plot, "a <title>")
    assert "a &lt;title&gt;" in svg and "NaN" not in svg and "nan" not in svg
    assert svg.count('stroke-width="1.5"') == 2  # the distance before and after the gap


def test_report_shows_the_plot_and_no_external_resource(tmp_path, record_of):
    write(tmp_path, record_of(DISTANCES))
    page = without_scripts((tmp_path / "report.html").read_text())
    assert page.count('<figure class="plot"') == 1
    assert '<div class="static"><img' in page
    assert not re.search(r"https?:|url\(|@import|<link|<iframe", page)


def test_names_of_close_lines_are_apart_in_the_static_picture(plot):
    lines = tuple(Line(value, f"line {value}", "#000") for value in (0.0, 0.1, 0.2))
    svg = time_svg(replace(plot, lines=lines), "x")
    heights = sorted(float(y) for y in re.findall(r'y="([0-9.]+)"[^>]*>line', svg))
    assert len(heights) == 3 and np.diff(heights).min() >= 15.0 - 0.1
    assert heights[0] > 20.0


@pytest.mark.parametrize("high", [0.001, 0.08, 1.02, 8.0, 79.0, 80.0, 81.0, 5400.0])
def test_axes_have_a_few_round_numbers(high):
    found = _ticks(0.0, high)
    assert 3 <= len(found) <= 9 and found[0] == 0.0 and found[-1] <= high


@given(st.lists(st.floats(0.0, 300.0), max_size=6))
def test_labels_never_overlap_and_keep_their_order(places):
    moved = spread(places, 14.0, 10.0)
    order = sorted(range(len(places)), key=lambda index: places[index])
    assert all(moved[b] - moved[a] >= 14.0 - 1e-9 for a, b in pairwise(order))
    assert min(moved, default=10.0) >= 10.0


@given(st.lists(st.integers(1, 20), min_size=1, max_size=6))
def test_labels_that_have_room_stay(steps):
    places = [20.0 * sum(steps[: index + 1]) for index in range(len(steps))]
    assert spread(places, 14.0, 10.0) == places


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_lowest_label_stays_and_the_others_move_up(order):
    places = [[100.0, 104.0, 106.0][index] for index in order]
    expected = [[78.0, 92.0, 106.0][index] for index in order]
    assert spread(places, 14.0, 0.0) == expected
