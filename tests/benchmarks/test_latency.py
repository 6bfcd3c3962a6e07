"""Short runs of the latency benchmark: the scene shows the sent poses, and it can fail."""

import json
import math
from contextlib import closing
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("pyigtl")
pytest.importorskip("rclpy")
pytest.importorskip("slicer")
pytest.importorskip(
    "PySide6.QtCore", reason="PySide6 cannot be loaded: apt install libegl1", exc_type=ImportError
)

from app.scene.nodes.convert import world_matrix
from benchmarks.latency.bodies import TURN_RAD, body_frames
from benchmarks.latency.kinds import KINDS, LISTENER, OURS, POLLED
from benchmarks.latency.measure import Sender, measure
from benchmarks.latency.plot import DELAYS, STOPS, write_plots
from benchmarks.latency.qt_loops import KEPT
from benchmarks.latency.receivers import complete_frame_stamp
from benchmarks.latency.results import Run, speed_targets, transports_ms
from benchmarks.latency.robot_sender import SWEEP_RAD, angle_at
from benchmarks.latency.stops import STOP_KINDS, delays_at, measure_stops
from benchmarks.latency.table import runs_table, stops_table
from tests.ros_domain import domain_id as domain_id

BODIES = 4
SECONDS = 0.5
BY_NAME = {kind.name: kind for kind in KINDS}
STOPS_BY_NAME = {kind.name: kind for kind in STOP_KINDS}


@pytest.mark.parametrize("name", [OURS, f"{OURS}, {KEPT}", "OpenIGTLink"])
def test_every_body_arrives_at_its_sent_pose(name, domain_id):
    kind = BY_NAME[name]
    with (
        Sender("sender", kind.sends, BODIES, kind.rate_hz, 0.0, SECONDS) as sender,
        closing(kind.open(BODIES, SECONDS, sender.port)) as receiver,
    ):
        receiver.run(sender.has_ended)
        nodes = receiver.poses.nodes.values() if name == "OpenIGTLink" else receiver.lookups
        poses = [world_matrix(node) for node in nodes]
    last = sender.report["sent"] - 1
    assert last == round(SECONDS * kind.rate_hz) - 1
    stamps = [stamp for stamp, _ in receiver.rows]
    assert sorted(stamps) == stamps
    assert len(poses) == len(body_frames(BODIES))
    for body, pose in enumerate(poses):
        x_mm, y_mm, z_mm = pose[:3, 3]
        assert x_mm == pytest.approx(0.1 * last, abs=1e-3)
        assert (y_mm, z_mm) == pytest.approx((10.0 * body, 5.0), abs=1e-3)
        turned = math.atan2(pose[1, 0], pose[0, 0])
        assert math.remainder(turned - TURN_RAD * last, math.tau) == pytest.approx(0.0, abs=1e-4)


def test_run_counts_frames_sent_after_the_warm_up(domain_id):
    run = measure(BY_NAME[OURS], SECONDS, BODIES)
    assert run.sent == round(SECONDS * run.kind.rate_hz)
    assert run.lost == 0
    assert run.shown + run.superseded == run.sent
    assert 0 < run.shown <= run.sent
    assert (run.delays_ms > 0.0).all()
    assert len(run.transport_ms) == run.shown
    assert (run.transport_ms <= run.delays_ms).all()
    console = Console(file=StringIO(), width=170)
    console.print(runs_table([run], "title"))
    assert f" {run.mean_ms:.2f} " in console.file.getvalue()
    json.dumps(run.document())


def test_plain_listener_measures_the_transport_alone(domain_id):
    run = measure(BY_NAME[LISTENER], SECONDS, BODIES)
    assert run.shown > 0
    assert len(run.transport_ms) == 0


def test_each_stop_of_each_of_two_robots_is_shown(domain_id, tmp_path):
    stops = measure_stops(STOPS_BY_NAME["two robots"], stops=2)
    assert [run.name for run in stops] == ["two robots: left", "two robots: right"]
    for run in stops:
        assert len(run.stops_ms) == 2
        assert (run.stops_ms > 0.0).all()
        assert len(run.frames_ms) > 20
        json.dumps(run.document())
    console = Console(file=StringIO(), width=170)
    console.print(stops_table(stops, "title"))
    assert f" {stops[0].stops_ms.mean():.2f} " in console.file.getvalue()
    runs = [run_of(BY_NAME[OURS], [1.0, 2.0, 3.0]), run_of(BY_NAME[POLLED], [4.0, 5.0])]
    write_plots(runs, stops, tmp_path / "plots")
    for name in (DELAYS, STOPS):
        assert (tmp_path / "plots" / name).read_bytes().startswith(b"\x89PNG")


def test_picture_of_a_stop_is_drawn_after_the_scene_shows_it(domain_id):
    (run,) = measure_stops(STOPS_BY_NAME["module ROS2, drawn"], stops=1)
    assert run.pictures_ms[0] > run.stops_ms[0]


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
    return Run(kind, sent or len(delays), arrived, delays, 0.5, none, none, none)


def test_each_requirement_can_fail():
    def verdict(ours_ms, polled_ms):
        runs = {
            OURS: run_of(BY_NAME[OURS], ours_ms),
            POLLED: run_of(BY_NAME[POLLED], polled_ms),
        }
        return [target.good for target in speed_targets(runs)]

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
