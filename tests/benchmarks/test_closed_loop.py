"""Separate processes in real time: pushes, and a controller that is killed meanwhile.

On a busy machine safe stops interrupt pushes; nothing here is judged by wall time alone.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")
pytest.importorskip("mujoco", reason="MuJoCo is not installed")

from app.fixture import ProximityEngine
from app.geometry import NS_PER_MS
from benchmarks.closed_loop.hand import AWAY_MM, Phase
from benchmarks.closed_loop.pushes import judged
from benchmarks.closed_loop.truth import Surfaces, Truth

STOP_MM = 1.0


def run(project_root: Path, path: Path, *options: str) -> tuple[str, list[dict[str, float]]]:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.closed_loop", *options, "--json", str(path)],
        cwd=project_root,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert path.exists(), done.stdout + done.stderr
    return done.stdout, json.loads(path.read_text())["rows"]


def test_fixture_keeps_the_pushes_out_that_breach_without_it(
    tmp_path: Path, project_root: Path
) -> None:
    printed, rows = run(project_root, tmp_path / "pushes.json", "--pushes", "2", "--seed", "3")
    assert [each["fixture"] for each in rows] == [False, False, True, True], printed
    # A push that safe stops interrupt may end before it reaches the tumour, also without a fixture.
    assert all(each["lowest_mm"] < 0.0 for each in rows[:2] if not each["stops"]), printed
    # Where nothing interrupts it, the fixture keeps the margin; a held tool may be breathed at.
    assert all(each["lowest_mm"] >= STOP_MM for each in rows[2:] if not each["stops"]), printed
    assert all(each["lowest_mm"] > -4.0 for each in rows[2:]), printed
    for each in rows:
        assert each["vertices_mm"] == pytest.approx(each["lowest_mm"], abs=0.1)


def test_arm_stands_after_a_killed_controller(tmp_path: Path, project_root: Path) -> None:
    printed, rows = run(project_root, tmp_path / "stops.json", "--stops", "--process", "controller")
    for row in rows:  # none if other stops came first in all tries
        assert row["still_ms"] is not None and row["lowest_mm"] > 0.0, printed


def write_truth(path: Path, away_mm: np.ndarray, phases: np.ndarray) -> Truth:
    """The truth of a tool that moves along z above a tumour that rests at the origin."""
    count = len(away_mm)
    poses = np.zeros((count, 24))
    poses[:, 2] = away_mm
    poses[:, 3:12] = poses[:, 15:] = np.eye(3).ravel()
    stamps = np.column_stack([np.arange(count) * NS_PER_MS, phases, np.ones(count)])
    np.savez(path, stamps=stamps.astype(np.int64), poses=poses)
    return Truth(path)


def test_judge_of_a_push_finds_distances_and_speeds(tmp_path: Path) -> None:
    surfaces = Surfaces.shipped()
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    top = float(surfaces.tumor.vertices_mm[:, 2].max())
    push, retreat = np.linspace(AWAY_MM, top - 3.0, 400), np.linspace(top - 3.0, AWAY_MM, 300)
    away_mm = np.concatenate([push, np.full(200, top - 3.0), retreat])
    phases = np.repeat([Phase.PUSH, Phase.SLIDE, Phase.RETREAT], [400, 200, 300])
    truth = write_truth(tmp_path / "truth.npz", away_mm, phases)
    found = judged(0, True, truth, engine, surfaces, (0, len(away_mm)), 2)
    assert found.lowest_mm == pytest.approx(found.breach_mm, abs=0.2)
    assert found.lowest_mm < -1.0
    assert found.vertices_mm >= found.lowest_mm - 1e-6
    assert found.approach_mm_s == pytest.approx((AWAY_MM - top + 3.0) / 0.4, rel=0.02)
    assert found.retreat_mm_s == pytest.approx((AWAY_MM - top + 3.0) / 0.3, rel=0.02)
    assert found.slide_mm_s == 0.0
    assert found.stops == 2


def test_tumour_that_moves_towards_a_standing_tool_is_no_breach(tmp_path: Path) -> None:
    surfaces = Surfaces.shipped()
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    top = float(surfaces.tumor.vertices_mm[:, 2].max())
    truth = write_truth(tmp_path / "a.npz", np.full(300, top + 4.0), np.full(300, Phase.PUSH))
    truth._poses[:, 14] = np.linspace(0.0, 4.0, 300)  # it rises
    found = judged(0, True, truth, engine, surfaces, (0, 300), 0)
    assert found.lowest_mm < STOP_MM
    assert found.breach_mm is None
