"""Replay of the real stylus recording, compared with independent matrix products."""

import csv
import json

import numpy as np
import pytest

from app.cli.main import main
from tests.cli.real_case import independent_distances_mm, write_real_case


@pytest.fixture(scope="module")
def plus(shared_data):
    return shared_data / "plus"


@pytest.fixture(scope="module")
def report(plus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("real")
    case = write_real_case(plus, folder / "case")
    status = main(["replay", str(case), "--tip-only", "--no-ros", "--report", str(folder / "out")])
    assert status == 0
    return folder / "out"


def test_published_breach_is_found(report):
    summary = json.loads((report / "summary.json").read_text())
    assert (summary["frames"], summary["valid_frames"]) == (1000, 1000)
    assert summary["inside_frames"] == 89
    (breach,) = summary["breaches"]
    assert breach["start_s"] == pytest.approx(4.914, abs=5e-4)
    assert breach["end_s"] == pytest.approx(10.758, abs=5e-4)
    assert breach["min_signed_distance_mm"] == pytest.approx(-9.746, abs=0.05)


def test_distance_of_every_frame_equals_independent_calculation(report, plus):
    with (report / "margin.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = np.array([float(row["signed_distance_mm"]) for row in rows])
    np.testing.assert_allclose(found, independent_distances_mm(plus), atol=0.05)
    inside = [index for index, distance in enumerate(found) if distance < 0.0]
    assert (inside[0], inside[-1], len(inside)) == (74, 162, 89)
    for row, distance in zip(rows, found, strict=True):
        if distance < 0.0:
            assert row["state"] == "POSITIVE"
