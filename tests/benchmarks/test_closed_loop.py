"""The judge of the closed loop: distances, speeds and breaches from the truth of a push."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed")
pytest.importorskip("igl", reason="libigl is not installed")

import igl

from app.fixture import ProximityEngine
from app.geometry import NS_PER_MS, Transform
from benchmarks.closed_loop.hand import AWAY_MM, Phase
from benchmarks.closed_loop.pushes import judged
from benchmarks.closed_loop.truth import Surfaces, Truth

pytestmark = pytest.mark.long

STOP_MM = 1.0


def write_truth(path: Path, away_mm: np.ndarray, phases: np.ndarray) -> Truth:
    """The truth of a tool that moves along z above a tumour that rests at the origin."""
    count = len(away_mm)
    poses = np.zeros((count, 24))
    poses[:, 2] = away_mm
    poses[:, 3:12] = poses[:, 15:] = np.eye(3).ravel()
    stamps = np.column_stack([np.arange(count) * NS_PER_MS, phases, np.ones(count)])
    np.savez(path, stamps=stamps.astype(np.int64), poses=poses)
    return Truth(path)


def test_judge_of_a_push_finds_distances_and_speeds(tmp_path):
    surfaces = Surfaces.shipped()
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    top = float(surfaces.tumor.vertices_mm[:, 2].max())
    push, retreat = np.linspace(AWAY_MM, top - 3.0, 400), np.linspace(top - 3.0, AWAY_MM, 300)
    away_mm = np.concatenate([push, np.full(200, top - 3.0), retreat])
    phases = np.repeat([Phase.PUSH, Phase.SLIDE, Phase.RETREAT], [400, 200, 300])
    truth = write_truth(tmp_path / "truth.npz", away_mm, phases)
    found = judged(0, True, truth, engine, surfaces, (0, len(away_mm)), {"lags": 2})
    assert found["lowest_mm"] == pytest.approx(found["breach_mm"], abs=0.2)
    assert found["lowest_mm"] < -1.0
    assert found["vertices_mm"] >= found["lowest_mm"] - 1e-6
    assert found["approach_mm_s"] == pytest.approx((AWAY_MM - top + 3.0) / 0.4, rel=0.02)
    assert found["retreat_mm_s"] == pytest.approx((AWAY_MM - top + 3.0) / 0.3, rel=0.02)
    assert found["slide_mm_s"] == 0.0
    assert found["stops"] == {"lags": 2}


def test_tumour_that_moves_towards_a_standing_tool_is_no_breach(tmp_path):
    surfaces = Surfaces.shipped()
    engine = ProximityEngine(surfaces.tumor, surfaces.tool)
    top = float(surfaces.tumor.vertices_mm[:, 2].max())
    truth = write_truth(tmp_path / "a.npz", np.full(300, top + 4.0), np.full(300, Phase.PUSH))
    truth._poses[:, 14] = np.linspace(0.0, 4.0, 300)  # it rises
    found = judged(0, True, truth, engine, surfaces, (0, 300), {})
    assert found["lowest_mm"] < STOP_MM
    assert found["breach_mm"] is None


def test_lowest_vertex_is_that_of_every_vertex_at_every_pose():
    """The intervals that are left out change nothing: beside libigl on all vertices and poses."""
    surfaces = Surfaces.shipped()
    random = np.random.default_rng(5)
    top = float(surfaces.tumor.vertices_mm[:, 2].max())
    turns = np.cumsum(random.normal(0.0, 0.02, (60, 3)), axis=0)
    places = np.cumsum(random.normal(0.0, 0.3, (60, 3)), axis=0)
    places[:, 2] += top + 2.0
    poses = [
        Transform.from_rotation_vector(turn, place, target="tumor", source="tool")
        for turn, place in zip(turns, places, strict=True)
    ]
    every = [
        igl.signed_distance(
            pose.apply(moved.vertices_mm), np.array(fixed.vertices_mm), fixed.faces.astype(np.int64)
        )[0].min()
        for moved, fixed, steps in (
            (surfaces.tool, surfaces.tumor, poses),
            (surfaces.tumor, surfaces.tool, [pose.inverse() for pose in poses]),
        )
        for pose in steps
    ]
    assert surfaces.lowest_vertex_mm(poses) == pytest.approx(min(every), abs=1e-9)
