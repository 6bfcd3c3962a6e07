"""Figures of the latency benchmark. Its loops of Qt: `qt_latency_checks`."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pyigtl")
pytest.importorskip("rclpy")
pytest.importorskip("slicer")

from benchmarks.latency.measure import KINDS, STOP_KINDS, StopRun, delays_at
from benchmarks.latency.receivers import complete_frame_stamp
from benchmarks.latency.results import (
    DELAYS_PNG,
    OURS,
    POLLED,
    STOPS_PNG,
    Run,
    goals,
    transports_ms,
    write_plots,
)
from benchmarks.latency.senders import SWEEP_RAD, angle_at

pytestmark = pytest.mark.slow

BY_NAME = {kind.name: kind for kind in KINDS}


def test_joint_moves_to_and_fro_with_rests():
    assert angle_at(0.0, 0.6, 0.4) == (0.0, 0, False)
    assert angle_at(0.3, 0.6, 0.4) == (pytest.approx(SWEEP_RAD / 2), 0, False)
    assert angle_at(0.7, 0.6, 0.4) == (SWEEP_RAD, 0, True)
    assert angle_at(1.9, 0.6, 0.4) == (0.0, 1, True)


def test_delay_at_a_stop_is_that_of_the_first_row_not_before_it():
    rows = [(10, 11_000_010), (20, 22_000_000), (30, 33_000_000)]
    assert delays_at([10, 15], rows) == pytest.approx([11.0, 21.999985])
    with pytest.raises(RuntimeError, match="a stop was not shown"):
        delays_at([31], rows)


def run_of(kind, delays_ms, *, sent=None, arrived=None):
    delays, none = np.array(delays_ms), np.empty(0)
    texts, counts = (kind.name, kind.what, kind.rate_hz), (sent or len(delays), arrived)
    return Run(*texts, *counts, delays, 0.5, none, none, none)


def test_each_requirement_can_fail():
    def verdict(ours_ms, polled_ms):
        runs = {OURS: run_of(BY_NAME[OURS], ours_ms), POLLED: run_of(BY_NAME[POLLED], polled_ms)}
        return [target.good for target in goals(runs)]

    assert verdict([1.0] * 100, [2.0] * 100) == [True, True, True]
    assert verdict([2.1] * 100, [9.0] * 100) == [False, True, True]
    assert verdict([1.0] * 98 + [6.0] * 2, [9.0] * 100) == [True, False, True]
    assert verdict([1.0] * 100, [1.9] * 100) == [True, True, False]


def test_lost_and_superseded_frames_are_distinguished():
    run = run_of(BY_NAME[OURS], [1.0, 2.0, 5.1, 7.0], sent=10, arrived=8)
    assert (run.shown, run.lost, run.superseded) == (4, 2, 4)
    unknown = replace(run, arrived=None)
    assert (unknown.lost, unknown.superseded) == (None, 6)
    both = run.concatenated(run)
    assert (both.sent, both.shown, both.lost, both.superseded) == (20, 8, 4, 8)
    assert both.mean_ms == run.mean_ms
    assert run.concatenated(unknown).lost is None


def test_transport_ends_at_the_next_arrival():
    rows = [(1_000_000, 9_000_000), (5_000_000, 9_500_000)]
    found = transports_ms(rows, [500_000, 1_400_000, 5_300_000], 0)
    assert found == pytest.approx([0.4, 0.3])
    assert len(transports_ms(rows, None, 0)) == 0


def test_frame_is_complete_if_no_body_is_of_an_earlier_one():
    assert complete_frame_stamp([10, 11, 12]) == 10
    assert complete_frame_stamp([20, 11, 12]) is None
    assert complete_frame_stamp([20, 21, 12]) is None
    assert complete_frame_stamp([20, 20, 20]) == 20


def test_plots_are_written(tmp_path):
    runs = [run_of(BY_NAME[OURS], [1.0, 2.0, 3.0]), run_of(BY_NAME[POLLED], [4.0, 5.0])]
    delays = np.array([1.0, 2.0])
    stops = [StopRun(STOP_KINDS[0], "left", delays, delays, delays, 0.5)]
    write_plots(runs, stops, tmp_path / "plots")
    for name in (DELAYS_PNG, STOPS_PNG):
        assert (tmp_path / "plots" / name).read_bytes().startswith(b"\x89PNG")
