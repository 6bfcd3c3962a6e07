"""Calibration action: one process moves the tool, another sends the goals."""

import json
from pathlib import Path

import numpy as np
import pytest
from marginguard_msgs.action import Calibrate

from app.bridge.calls.calibrate_server import CalibrateServer
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener

pytestmark = pytest.mark.slow

HERE = Path(__file__).resolve().parent
TOOL, SENDER = HERE / "tool_sender.py", HERE / "goal_sender.py"
CALIBRATE = "marginguard_msgs/action/Calibrate"
TIP_M = np.array([5.0, 12.6, 103.3]) / 1000.0


@pytest.fixture
def calibrate(ros, start_receiver):
    """``calibrate("pivot", {...}, ...)`` sends goals during that motion; returns the replies."""
    buffer = TransformBuffer()
    TfListener(ros, buffer)
    CalibrateServer(ros, buffer)

    def send(motion, *goals):
        start_receiver(motion, script=TOOL)
        defaults = {"frame": "stylus", "parent_frame": "reference", "samples": 60, "timeout": 30.0}
        texts = [json.dumps({**defaults, **goal}) for goal in goals]
        return start_receiver("/marginguard/calibrate", CALIBRATE, *texts, script=SENDER).messages()

    return send


def point(reply):
    vector = reply["result"]["transform"]["transform"]["translation"]
    return np.array([vector["x"], vector["y"], vector["z"]])


def test_pivot_goal_gives_the_tip_and_its_residual(calibrate):
    (reply,) = calibrate("pivot", {"method": Calibrate.Goal.PIVOT})
    assert reply["status"] == "succeeded"
    assert reply["result"]["samples"] == 60
    assert np.linalg.norm(point(reply) - TIP_M) < 0.0001
    assert reply["result"]["transform"]["header"]["frame_id"] == "stylus"
    # 0.05 mm along each axis.
    assert reply["result"]["residual"] == pytest.approx(0.00005 * 3**0.5, rel=0.4)
    assert reply["last"]["samples"] == 60
    assert 0.5 < reply["last"]["variation"] < 2.1


def test_spin_goal_gives_the_tip_rotation(calibrate):
    (reply,) = calibrate("spin", {"method": Calibrate.Goal.SPIN, "samples": 40})
    assert reply["status"] == "succeeded"
    assert np.allclose(point(reply), TIP_M, atol=1e-9)
    rotation = reply["result"]["transform"]["transform"]["rotation"]
    # The tip's z-axis is the stylus's z-axis, so the rotation is about z only.
    assert np.hypot(rotation["x"], rotation["y"]) < 1e-6


def test_landmark_goal_succeeds_and_invalid_goals_fail(calibrate):
    landmark, pivot, unknown, nonsense, cancelled = calibrate(
        "still",
        {"method": Calibrate.Goal.LANDMARK, "frame": "stylus_tip", "samples": 300},
        {"method": Calibrate.Goal.PIVOT, "timeout": 0.3},
        {"method": Calibrate.Goal.PIVOT, "frame": "missing", "timeout": 0.1},
        {"method": 9},
        {"method": Calibrate.Goal.PIVOT, "cancel_after": 1},
    )
    assert landmark["status"] == "succeeded"
    assert np.allclose(point(landmark), [0.1, -0.05, 0.02], atol=0.0002)
    assert pivot["status"] == "aborted"
    assert "expected at least 10" in pivot["result"]["message"]
    assert "'missing' in 'reference'" in unknown["result"]["message"]
    assert "calibration method is 9" in nonsense["result"]["message"]
    assert cancelled["status"] == "cancelled"
    count = cancelled["result"]["samples"]
    assert count in (0, 1)  # 0: feedback came before the first pose; the tool is at rest
    assert cancelled["result"]["message"] == f"cancelled after {count} poses"
