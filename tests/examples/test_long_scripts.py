"""Examples on whole cases: a review of the shipped case, and a scene for 3D Slicer."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.examples.conftest import NUMBER, RunExample, numbers

pytestmark = pytest.mark.long

CASE = Path("data/recorded_case")


def test_review_case_finds_the_breaches_that_were_simulated(
    run_example: RunExample, project_root: Path, tmp_path: Path
) -> None:
    printed = run_example("review_case.py", folder=tmp_path)
    breaches = numbers(rf"breach \d: {NUMBER} to {NUMBER} s, {NUMBER} mm deep", printed)
    truth = yaml.safe_load((project_root / CASE / "expected.yaml").read_text())
    expected = truth["breaches"]
    assert len(breaches) == len(expected["intervals"]) == 3
    for (start_s, end_s, depth_mm), breach in zip(breaches, expected["intervals"], strict=True):
        assert abs(start_s - breach["start_s"]) < 0.05
        assert abs(end_s - breach["end_s"]) < 0.05
        assert abs(depth_mm + breach["min_signed_distance_mm"]) < expected["depth_tolerance_mm"]
    counts = dict(re.findall(r"([A-Z]+) +(\d+) frames", printed))
    assert sum(map(int, counts.values())) == truth["frames"]
    # Every dropout is UNKNOWN until tracking is steady again.
    lost_s = sum(span["end_s"] - span["start_s"] for span in truth["dropouts"])
    assert 0 < int(counts["UNKNOWN"]) < 50 * lost_s
    assert (tmp_path / "margin.png").read_bytes().startswith(b"\x89PNG")


def test_saved_scene_shows_the_deepest_step(
    run_example: RunExample, own_case: tuple[Path, str], tmp_path: Path
) -> None:
    """The scene's closest points are 3 mm apart; the recording is in it."""
    printed = run_example("slicer_scene.py", str(own_case[0]), folder=tmp_path)
    assert abs(numbers(rf"frame 50: {NUMBER} mm", printed)[0, 0] + 3.0) < 0.02
    with zipfile.ZipFile(tmp_path / "deepest.mrb") as bundle:
        files = {Path(name).name: name for name in bundle.namelist()}
        points = json.loads(bundle.read(files["ClosestPoints.mrk.json"]))
    ends = [np.array(point["position"]) for point in points["markups"][0]["controlPoints"]]
    assert abs(np.linalg.norm(ends[0] - ends[1]) - 3.0) < 0.02
    assert "MarginGuard-CauteryToTracker-Seq.seq.mha" in files
