"""Pushes of a simulated hand: stopped by the fixture in physics, and not without it."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.guided import main
from benchmarks.push_simulation import MARGINS


def test_fixture_stops_the_push_and_a_push_without_it_breaches(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--pushes", "1", "--seed", "3", "--json"]) == 0
    without, guided = json.loads(capsys.readouterr().out)
    assert (without["fixture"], guided["fixture"]) == (False, True)
    assert without["lowest_mm"] < 0.0
    assert MARGINS.stop_mm <= guided["lowest_mm"] < 6.0
    assert guided["stops"] == 0
    assert guided["retreat_mm_s"] == pytest.approx(without["retreat_mm_s"], rel=0.05)


def test_movie_shows_the_push_without_and_with_the_fixture(tmp_path: Path) -> None:
    pytest.importorskip("slicer", reason="the scene is not installed")
    file = tmp_path / "push.gif"
    assert main(["--gif", str(file)]) == 0
    assert file.stat().st_size < 1_500_000
    with Image.open(file) as movie:
        assert movie.n_frames >= 40
        redness = []
        for number in range(movie.n_frames):
            movie.seek(number)
            picture = np.asarray(movie.convert("RGB"), dtype=int)
            halves = np.array_split(picture[:40], 2, axis=1)  # the banners
            redness.append([float((h[..., 0] - h[..., 1]).mean()) for h in halves])
    without, guided = np.max(redness, axis=0)
    assert without > 100.0 > guided  # only the banner of a breach is red
