"""Figures of the soak benchmark."""

import json

import numpy as np
import pytest

from benchmarks.soak.__main__ import BARE, GUARD, failures, figures, interpolate, slope_mb_h
from benchmarks.soak.receiver import Stream, percentile_ms


def rows(live_mb):
    return [{"s": 5.0 * index, "live": mb, "record": 100.0} for index, mb in enumerate(live_mb)]


def topics(guard_ms, bare_ms, guard_p9999_ms=1.0, bare_p9999_ms=1.0):
    return {
        GUARD: {"max_gap_ms": guard_ms, "p9999_gap_ms": guard_p9999_ms},
        BARE: {"max_gap_ms": bare_ms, "p9999_gap_ms": bare_p9999_ms},
    }


def test_growth_is_measured_after_the_warm_up_and_without_outliers():
    memory = np.concatenate([np.linspace(100.0, 300.0, 100), np.full(400, 300.0)])
    memory[300] = 900.0
    found = figures(rows(memory), topics(5.0, 5.0))
    assert found["live: MB/h"] == 0.0
    assert found["failures"] == []
    growing = memory + np.arange(500) * 5.0 / 3600.0 * 2.0
    found = figures(rows(growing), topics(5.0, 5.0))
    assert found["live: MB/h"] == pytest.approx(2.0, abs=0.01)
    assert "grows by" in found["failures"][0]


def test_two_samples_have_no_slope():
    assert slope_mb_h(rows([1.0, 2.0]), "live") is None


def test_gap_counts_only_beyond_twice_the_bare_senders():
    steady = rows(np.full(100, 300.0))
    assert failures(figures(steady, topics(99.0, 50.0))) == []
    assert "gap of 101.0 ms" in failures(figures(steady, topics(101.0, 50.0)))[0]
    assert failures(figures(steady, topics(9.0, 1.0))) == []


def test_percentile_is_compared_with_the_bare_senders():
    steady = rows(np.full(100, 300.0))
    assert failures(figures(steady, topics(5.0, 5.0, 1.19, 1.0))) == []
    assert "99.99 %" in failures(figures(steady, topics(5.0, 5.0, 1.21, 1.0)))[0]


def test_short_run_has_no_limit_of_growth():
    growing = rows(300.0 + np.arange(100) * 0.1)
    assert figures(growing, topics(5.0, 5.0))["live: MB/h"] > 1.0
    assert failures(figures(growing, topics(5.0, 5.0))) == []


def test_percentile_of_the_histogram_agrees_with_numpy():
    stream = Stream()
    assert stream.figures()["p9999_gap_ms"] == 0.0
    rng = np.random.default_rng(1)
    gaps_ns = (rng.exponential(1e6, 200_000)).astype(np.int64)
    for gap_ns in gaps_ns:
        stream.histogram[gap_ns // 10_000] += 1
    expected_ms = np.percentile(gaps_ns, 99.99, method="inverted_cdf") / 1e6
    assert 0.0 <= percentile_ms(stream.histogram, 0.9999) - expected_ms <= 0.01


def test_scene_is_interpolated_to_a_higher_rate(tmp_path):
    half = np.sqrt(0.5)
    frames = [
        {"edges": [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], "joints": [0.0]},
        {"edges": [[4.0, 0.0, 0.0, 0.0, 0.0, -half, -half]], "joints": [1.0]},
    ]
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"period_ns": 20_000_000, "frames": frames}))
    interpolate(path, 200)
    scene = json.loads(path.read_text())
    assert scene["period_ns"] == 5_000_000
    assert [frame["edges"][0][0] for frame in scene["frames"]] == [0.0, 1.0, 2.0, 3.0]
    assert [frame["joints"][0] for frame in scene["frames"]] == [0.0, 0.25, 0.5, 0.75]
    # The same rotation as -q is 90 degrees away, not 270.
    assert scene["frames"][2]["edges"][0][6] == pytest.approx(np.cos(np.pi / 8.0))
