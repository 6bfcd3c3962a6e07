"""The benchmark of a physics step: figures of a small world, and one line for a wrong one."""

import json
from pathlib import Path

import pytest

from benchmarks.simulation import GOAL_MS, main

WORLD = """
schema: 1
name: small
seed: 1
robots:
  - name: arm
    file: package://marginguard/robots/touch/touch.urdf
    density_kg_m3: 1000.0
"""


def test_figures_of_a_small_world(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "world.yaml").write_text(WORLD)
    status = main([str(tmp_path), "--steps", "300", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert status == int(found["world_step"]["p99_ms"] > GOAL_MS)
    assert (found["world"], found["degrees_of_freedom"], found["steps"]) == ("small", 6, 300)
    for name in ("world_step", "mj_step"):
        figures = found[name]
        assert 0.0 < figures["p50_ms"] <= figures["p99_ms"] <= figures["max_ms"]
    assert main([str(tmp_path), "--steps", "300"]) in (0, 1)
    assert "world_step  CPU p50" in capsys.readouterr().out


def test_missing_world_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 2
    assert "is not a world; expected a world.yaml or its folder" in capsys.readouterr().err
