"""Figures of the page's benchmark, and the numbers that it reads back from pixels."""

import io

import numpy as np
import pytest
from PIL import Image

from benchmarks.harness.goals import missed
from benchmarks.view.__main__ import figures, goals
from benchmarks.view.stamps import BITS, SIDE, stamp

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", [0, 1, 3740, 65535])
def test_number_survives_jpeg_compression(number):
    pixels = np.random.default_rng(2).integers(0, 255, (200, 400, 3)).astype(np.uint8)
    stamp(pixels, number)
    coded = io.BytesIO()
    Image.fromarray(pixels).save(coded, "jpeg", quality=50)
    lit = np.asarray(Image.open(coded).convert("L")) > 127
    rows = [
        [bool(lit[row * SIDE + SIDE // 2, bit * SIDE + SIDE // 2]) for bit in range(BITS)]
        for row in (0, 1)
    ]
    assert sum(2**bit for bit, on in enumerate(rows[0]) if on) == number
    assert rows[1] == [not on for on in rows[0]]


def test_delay_is_measured_from_the_due_time():
    due_ms = [1000.0 + 20.0 * frame for frame in range(100)]
    seen = [[frame, due_ms[frame] + 80.0] for frame in range(0, 100, 5)]
    found = figures(seen, due_ms, seconds=2.0)
    assert (found["pictures"], found["per_s"]) == (20, 10.0)
    assert {found[f"delay_{name}_ms"] for name in ("p50", "p95", "max")} == {80.0}
    assert (found["longest_gap_ms"], found["growth_ms"]) == (100.0, 0.0)
    assert missed(goals(found)) == []


def test_low_rate_delay_and_growth_are_failures():
    due_ms = [20.0 * frame for frame in range(1000)]
    seen = [[frame, due_ms[frame] + 200.0 + frame] for frame in range(0, 1000, 10)]
    found = figures(seen, due_ms, seconds=20.0)
    assert found["growth_ms"] == pytest.approx(750.0)
    assert [sentence.split(";")[0] for sentence in missed(goals(found))] == [
        "there are 5 pictures a second",
        f"p95 of the delay is {found['delay_p95_ms']:g} ms",
        "the delay grew by 750 ms",
    ]
