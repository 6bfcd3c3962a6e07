"""Figures of the soak benchmark."""

import numpy as np
import pytest

from benchmarks.harness.goals import missed
from benchmarks.soak.__main__ import figures, goals, slope_mb_h
from benchmarks.soak.processes import BARE, GUARD, Stream, percentile_ms

pytestmark = pytest.mark.slow


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
    assert missed(goals(found)) == []
    growing = memory + np.arange(500) * 5.0 / 3600.0 * 2.0
    found = figures(rows(growing), topics(5.0, 5.0))
    assert found["live: MB/h"] == pytest.approx(2.0, abs=0.01)
    assert "grows by" in missed(goals(found))[0]


def test_two_samples_have_no_slope():
    assert slope_mb_h(rows([1.0, 2.0]), "live") is None


def test_gap_counts_only_beyond_twice_the_bare_senders():
    steady = rows(np.full(100, 300.0))
    assert missed(goals(figures(steady, topics(99.0, 50.0)))) == []
    assert "gap of 101.0 ms" in missed(goals(figures(steady, topics(101.0, 50.0))))[0]
    assert missed(goals(figures(steady, topics(9.0, 1.0)))) == []


def test_percentile_is_compared_with_the_bare_senders():
    steady = rows(np.full(100, 300.0))
    assert missed(goals(figures(steady, topics(5.0, 5.0, 1.19, 1.0)))) == []
    assert "99.99 %" in missed(goals(figures(steady, topics(5.0, 5.0, 1.21, 1.0))))[0]


def test_short_run_has_no_limit_of_growth():
    growing = rows(300.0 + np.arange(100) * 0.1)
    assert figures(growing, topics(5.0, 5.0))["live: MB/h"] > 1.0
    assert missed(goals(figures(growing, topics(5.0, 5.0)))) == []


def test_percentile_of_the_histogram_agrees_with_numpy():
    stream = Stream()
    assert stream.figures()["p9999_gap_ms"] == 0.0
    rng = np.random.default_rng(1)
    gaps_ns = (rng.exponential(1e6, 200_000)).astype(np.int64)
    for gap_ns in gaps_ns:
        stream.histogram[gap_ns // 10_000] += 1
    expected_ms = np.percentile(gaps_ns, 99.99, method="inverted_cdf") / 1e6
    assert 0.0 <= percentile_ms(stream.histogram, 0.9999) - expected_ms <= 0.01
