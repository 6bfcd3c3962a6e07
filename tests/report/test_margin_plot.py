from dataclasses import replace
from io import BytesIO

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread

from app.analysis import find_breaches
from app.fixture import MarginState
from app.report.margin_plot import margin_png
from app.report.rows import played_seconds, state_bands

pytestmark = pytest.mark.slow

DISTANCES = [9.0] * 30 + [3.0] * 30 + [-2.0] * 30 + [None] * 30 + [9.0] * 30


def drawn(rows, margins):
    return margin_png(rows, find_breaches(rows, margins.stale_after_ns), margins, "a case")


def pixels(png):
    return imread(BytesIO(png))[..., :3]


def count(picture, color):
    return int((np.abs(picture - np.array(color)).max(axis=-1) < 0.02).sum())


@pytest.fixture(scope="module")
def png(rows_of, margins):
    """The plot of `DISTANCES`."""
    return drawn(rows_of(DISTANCES), margins)


def test_every_state_has_a_part_of_the_strip(png):
    picture = pixels(png)
    assert picture.shape == (720, 1560, 3)
    counts = {state: count(picture, state.color) for state in MarginState}
    assert min(counts.values()) > 2000
    assert counts[MarginState.NEGATIVE] > 1.5 * counts[MarginState.WARNING]


def test_state_that_did_not_occur_is_in_the_legend_only(rows_of, margins):
    picture = pixels(drawn(rows_of([9.0] * 50), margins))
    assert count(picture, MarginState.POSITIVE.color) < 1000


def test_same_rows_have_the_same_bytes_and_settings_of_matplotlib_stay(png, rows_of, margins):
    before = dict(mpl.rcParams)
    assert drawn(rows_of(DISTANCES), margins) == png
    assert dict(mpl.rcParams) == before


def test_bands_cover_the_time_without_gap(rows_of):
    rows = rows_of([9.0, 9.0, 3.0, None])
    seconds = np.array([0.0, 0.02, 0.04, 0.06])
    assert list(state_bands(rows, seconds)) == [
        (MarginState.NEGATIVE, 0.0, 0.04),
        (MarginState.WARNING, 0.04, 0.06),
        (MarginState.UNKNOWN, 0.06, 0.06),
    ]


def test_title_is_not_parsed_as_math_and_one_frame_without_distance_is_drawn(rows_of, margins):
    title = r"costs $5 \frac{ and $6"
    assert margin_png(rows_of([None]), (), margins, title).startswith(b"\x89PNG")


def test_clock_that_jumps_back_is_drawn_as_played(rows_of, margins):
    rows = rows_of(DISTANCES)
    jumped = (*rows, *(replace(row, stamp_ns=row.stamp_ns - 10**12) for row in rows))
    seconds = played_seconds(jumped)
    assert (np.diff(seconds) >= 0.0).all()
    assert seconds[-1] == 2 * played_seconds(rows)[-1]
    assert pixels(drawn(jumped, margins)).shape == (720, 1560, 3)


def test_legend_is_not_cut_off(png):
    legend = pixels(png)[-45:]
    assert (legend[:, :300] < 0.5).any()
    assert (legend[:, -6:] == 1.0).all()
