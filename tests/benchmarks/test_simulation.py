"""The benchmark of a physics step: figures of a small world, and one line for a wrong one."""

import json

import numpy as np
import pytest

from app.geometry import NS_PER_MS, MarginGuardError
from benchmarks.simulation.__main__ import GOAL_MS, main, pace_of

pytestmark = pytest.mark.slow

WORLD = """
schema: 1
name: small
seed: 1
robots:
  - name: arm
    file: package://marginguard/robots/touch/touch.urdf
    density_kg_m3: 1000.0
"""


def test_figures_of_a_small_world(tmp_path, capsys):
    (tmp_path / "world.yaml").write_text(WORLD)
    path = tmp_path / "figures.json"
    status = main([str(tmp_path), "--steps", "300", "--json", str(path)])
    found = json.loads(path.read_text())
    assert status == int(found["world_step"]["p99_ms"] > GOAL_MS)
    assert (found["world"], found["degrees_of_freedom"], found["steps"]) == ("small", 6, 300)
    for name in ("world_step", "mj_step"):
        figures = found[name]
        assert 0.0 < figures["p50_ms"] <= figures["p99_ms"] <= figures["max_ms"]
    assert "world_step" in capsys.readouterr().out


def test_missing_world_is_named(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    assert "is not a world; expected a world.yaml or its folder" in capsys.readouterr().err


def test_pace_finds_drift_lags_and_lost_messages():
    """Independent of the clock: 10 s each, 3 ms late at first and 4.5 ms at the end."""
    period_ns = 5 * NS_PER_MS
    stamps_ns = np.arange(4000) * period_ns + 1_800_000_000 * 1_000_000_000
    delays_ms = np.repeat([3.0, 4.5], 2000)
    delays_ms[7] = 20.0
    pace = pace_of(stamps_ns, stamps_ns + (delays_ms * NS_PER_MS).astype(np.int64), period_ns)
    assert pace["drift_ms"] == pytest.approx(1.5)
    assert (pace["max_ms"], pace["missing_s"]) == (20.0, 0.0)
    assert pace["seconds"] == pytest.approx(19.995)
    stamps_ns[2500:] += 31 * NS_PER_MS  # a lag that the physics has dropped
    kept = np.delete(stamps_ns, 10)
    assert pace_of(kept, kept, period_ns)["missing_s"] == pytest.approx(0.036)
    with pytest.raises(MarginGuardError, match="1 poses; expected at least 2"):
        pace_of(stamps_ns[:1], stamps_ns[:1], period_ns)
