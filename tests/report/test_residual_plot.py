from functools import cache
from io import BytesIO

import numpy as np
import pytest
from matplotlib import image

from app.report import ReportError
from app.report.margin_plot import residual_png

pytestmark = pytest.mark.slow

VALUES = np.array([0.2, 0.4, 9.0, 0.1])


@cache
def picture(across="pair", **options):
    png = residual_png(VALUES, title="t", what="distance", unit="mm", across=across, **options)
    return image.imread(BytesIO(png))[..., :3]


def count(pixels, color):
    return int((np.abs(pixels * 255.0 - color).max(axis=-1) < 2.0).sum())


def test_dropped_points_look_different():
    used = (0x00, 0x72, 0xB2)
    all_used, one_dropped = picture(), picture(outliers=(2,))
    assert all_used.shape == (540, 1200, 3)
    # The largest bar makes up most of the blue.
    assert count(one_dropped, used) < 0.3 * count(all_used, used)
    assert count(one_dropped, (0xC8, 0x38, 0x1E)) > count(all_used, (0xC8, 0x38, 0x1E))


def test_labels_are_not_parsed_as_math():
    """A single dollar sign would make math text invalid."""
    assert np.any(picture(labels=("#1", "$2", "C_3", "D")) != picture())


@pytest.mark.parametrize("labels", [(), ("1", "2", "3", "4")])
def test_both_axes_are_labelled(labels):
    changed = np.any(picture("pair", labels=labels) != picture("riap", labels=labels), axis=-1)
    rows, columns = np.nonzero(changed)
    assert len(rows)
    # Below the bars, in the middle.
    assert rows.min() > 0.9 * changed.shape[0]
    assert abs(np.mean(columns) / changed.shape[1] - 0.5) < 0.1


def test_the_same_values_give_the_same_bytes():
    np.testing.assert_array_equal(picture(), picture.__wrapped__())


def test_empty_values_are_refused():
    with pytest.raises(ReportError, match="residuals: 0 values; expected"):
        residual_png(np.empty(0), title="t", what="distance", unit="mm", across="pair")
