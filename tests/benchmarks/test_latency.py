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

from app.robot import load_robot
from app.scene.nodes.convert import world_matrix
from app.synthetic.touch_arm import TOUCH_URDF
from benchmarks.latency.bodies import TURN_RAD, body_frames
from benchmarks.latency.measure import Sender, measure
from benchmarks.latency.plot import write_plots
from benchmarks.latency.receivers import KINDS, OURS, POLLED, complete_frame_stamp
from benchmarks.latency.results import Run, speed_targets
from benchmarks.latency.table import runs_table
from tests.ros_domain import domain_id as domain_id

BODIES = 4
SECONDS = 0.5
BY_NAME = {kind.name: kind for kind in KINDS}


def last_poses(kind):
    """Run a receiver to the end; returns its models' poses, its stamps and the sender's report."""
    stamps = []
    with (
        Sender(kind, BODIES, SECONDS, warm_up_s=0.0) as sender,
        closing(kind.open(BODIES, SECONDS, sender.port)) as receiver,
    ):
        while not sender.ended:
            stamps.append(receiver.update())
        poses = {
            name: world_matrix(model.GetParentTransformNode())
            for name, model in receiver.models.models.items()
        }
    return poses, [stamp for stamp in stamps if stamp is not None], sender.report


@pytest.mark.parametrize("name", [OURS, POLLED, "OpenIGTLink"])
def test_every_body_arrives_at_its_sent_pose(name, domain_id):
    kind = BY_NAME[name]
    poses, stamps, report = last_poses(kind)
    last = report["sent"] - 1
    assert last == SECONDS * kind.rate_hz - 1
    assert sorted(stamps) == stamps
    assert list(poses) == list(body_frames(BODIES))
    for body, pose in enumerate(poses.values()):
        x_mm, y_mm, z_mm = pose[:3, 3]
        # Looked up at the first body's stamp, so the others lie between the last two frames.
        assert 0.1 * (last - 1) - 1e-3 <= x_mm <= 0.1 * last + 1e-3
        assert (y_mm, z_mm) == pytest.approx((10.0 * body, 5.0), abs=1e-3)
        turned = math.atan2(pose[1, 0], pose[0, 0])
        assert math.remainder(turned - TURN_RAD * 10.0 * x_mm, math.tau) == pytest.approx(
            0.0, abs=1e-4
        )


def test_links_match_the_forward_kinematics_of_the_joints(domain_id):
    poses, stamps, report = last_poses(BY_NAME["joints"])
    robot = load_robot(TOUCH_URDF)
    angle = 0.3 * math.sin(TURN_RAD * (report["sent"] - 1))
    expected = robot.forward_kinematics(dict.fromkeys(robot.actuated_joint_names, angle))
    assert len(poses) == len(expected) > 1
    assert sorted(stamps) == stamps
    for link, pose in poses.items():
        assert np.allclose(pose, expected[link].matrix, rtol=0, atol=1e-9)


def test_run_counts_frames_sent_after_the_warm_up(domain_id, tmp_path):
    run = measure(BY_NAME[OURS], SECONDS, BODIES)
    assert run.sent == SECONDS * run.kind.rate_hz
    assert run.lost == 0
    assert run.shown + run.superseded == run.sent
    assert 0 < run.shown <= run.sent
    assert (run.delays_ms > 0.0).all()
    assert (np.diff(run.stamps_ns) > 0).all()
    console = Console(file=StringIO(), width=150)
    console.print(runs_table([run], "title"))
    assert f" {run.mean_ms:.2f} " in console.file.getvalue()
    json.dumps(run.document())
    write_plots([run, run], tmp_path / "plots")
    assert all(
        (tmp_path / "plots" / name).read_bytes().startswith(b"\x89PNG")
        for name in ("latency_histogram.png", "latency_frames.png")
    )


def run_of(kind, delays_ms, *, sent=None, arrived=None):
    stamps_ns = np.arange(len(delays_ms))
    return Run(kind, sent or len(delays_ms), arrived, stamps_ns, np.array(delays_ms), 0.5)


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


def test_lost_superseded_and_late_frames_are_distinguished():
    run = run_of(BY_NAME[OURS], [1.0, 2.0, 5.1, 7.0], sent=10, arrived=8)
    assert (run.shown, run.lost, run.superseded, run.late) == (4, 2, 4, 2)
    unknown = replace(run, arrived=None)
    assert (unknown.lost, unknown.superseded) == (None, 6)
    both = run.concatenated(run)
    assert (both.sent, both.shown, both.lost, both.superseded) == (20, 8, 4, 8)
    assert both.mean_ms == run.mean_ms
    assert run.concatenated(unknown).lost is None


def test_frame_is_complete_if_no_body_is_of_an_earlier_one():
    assert complete_frame_stamp([10, 11, 12]) == 10
    assert complete_frame_stamp([20, 11, 12]) is None
    assert complete_frame_stamp([20, 21, 12]) is None
    assert complete_frame_stamp([20, 20, 20]) == 20
