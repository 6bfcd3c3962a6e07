"""Short runs of the latency benchmark in a loop of Qt: the scene shows the sent poses."""

import json
import math
from contextlib import closing
from io import StringIO

import pytest
from rich.console import Console

pytest.importorskip("pyigtl")
pytest.importorskip("rclpy")
pytest.importorskip("slicer")
pytest.importorskip(
    "PySide6.QtCore", reason="PySide6 cannot be loaded: apt install libegl1", exc_type=ImportError
)

from app.scene.convert import world_matrix
from benchmarks.harness.figures import columns_table
from benchmarks.latency.measure import KINDS, measure, sending
from benchmarks.latency.receivers import KEPT
from benchmarks.latency.results import OURS, RUN_COLUMNS
from benchmarks.latency.senders import TURN_RAD, body_frames
from tests.ros_domain import domain_id as domain_id

pytestmark = pytest.mark.slow

BODIES = 4
SECONDS = 0.5
BY_NAME = {kind.name: kind for kind in KINDS}


@pytest.mark.parametrize("name", [OURS, f"{OURS}, {KEPT}", "OpenIGTLink"])
def test_every_body_arrives_at_its_sent_pose(name, domain_id):
    kind = BY_NAME[name]
    with (
        sending((kind.sends, BODIES, kind.rate_hz, 0.0, SECONDS)) as ((sender,), port),
        closing(kind.open(BODIES, port)) as receiver,
    ):
        receiver.run(sender.has_event)
        report = sender.expect("sent")
        nodes = receiver.poses.nodes.values() if name == "OpenIGTLink" else receiver.lookups
        poses = [world_matrix(node) for node in nodes]
    last = report["sent"] - 1
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
    assert run.sent == round(SECONDS * run.rate_hz)
    assert run.lost == 0
    assert run.shown + run.superseded == run.sent
    assert 0 < run.shown <= run.sent
    assert (run.delays_ms > 0.0).all()
    assert len(run.transport_ms) == run.shown
    assert (run.transport_ms <= run.delays_ms).all()
    console = Console(file=StringIO(), width=170)
    console.print(columns_table("title", [run.document()], RUN_COLUMNS))
    assert f" {run.mean_ms:.3f} " in console.file.getvalue()
    json.dumps(run.document())
