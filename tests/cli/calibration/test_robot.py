"""``calibrate hand-eye``, ``calibrate time`` and ``calibrate robot-base`` on the recorded case.

The joints of the case come from the kinematics of the arm, its poses from a simulated tracker. The
ground truth in `expected.yaml` was written before noise and other errors were added.
"""

import itertools
import re
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import yaml

from app.case import JointSample, open_case, write_recording
from app.files import read_transform
from app.geometry import Transform
from app.synthetic.simulation import ROBOT_TO_TRACKER_OFFSET_NS
from app.synthetic.tracker_model import AURORA
from tests.cli.calibration.white_noise import write_white_case
from tests.cli.command import refused, run, run_json
from tests.cli.small_case import write_small_case
from tests.shipped_case import CLOCK_OFFSET_MS

pytestmark = pytest.mark.long

KEY = "offset_robot_to_tracker_ms"
TRUE_LAG_MS = ROBOT_TO_TRACKER_OFFSET_NS / 1e6 + 1000.0 * AURORA.latency_s
"""Offset with which the recording was made; that of the case's manifest has an error of 2 ms."""


@pytest.fixture(scope="module")
def case(project_root: Path) -> Path:
    return project_root / "data" / "recorded_case"


@pytest.fixture(scope="module")
def true_base(case: Path) -> Transform:
    expected = yaml.safe_load((case / "expected.yaml").read_text())
    return Transform.from_matrix(
        expected["registration"]["reference_from_base"], target="reference", source="robot_base"
    )


def transform_of(found: dict) -> Transform:
    entry = found["transform"]
    return Transform.from_matrix(entry["matrix"], target=entry["target"], source=entry["source"])


def mean_sensor_position(case: Path) -> np.ndarray:
    """Mean position (3,) in mm of the cautery's sensor in the reference frame.

    Computed without `PoseTree`.
    """
    positions_mm = []
    for frame in open_case(case).recorded_frames():
        poses = {pose.source: pose.transform for pose in frame.poses}
        if poses.get("cautery") is not None and poses.get("reference") is not None:
            positions_mm.append((poses["reference"].inverse() @ poses["cautery"]).translation_mm)
    return np.mean(positions_mm, axis=0)


def error_at_the_sensor_mm(case: Path, base: Transform, true_base: Transform) -> float:
    middle_in_base = true_base.inverse().apply(mean_sensor_position(case))
    return float(np.linalg.norm(base.apply(middle_in_base) - true_base.apply(middle_in_base)))


def test_hand_eye_error_is_within_three_predicted_sigmas(case, true_base, tmp_path):
    plot = tmp_path / "h.png"
    white = write_white_case(case, tmp_path / "white", true_base, 75.0)
    found = run_json("calibrate", "hand-eye", white, "--plot", plot)
    numbers = found["numbers"]
    assert found["transform"]["name"] == "RobotBaseToReference"
    base = transform_of(found)
    error_mm = error_at_the_sensor_mm(white, base, true_base)
    assert numbers["sigma_at_centre_mm"] < 0.6
    assert error_mm < 3.0 * numbers["sigma_at_centre_mm"]
    assert np.degrees(base.angle_to(true_base)) < 3.0 * numbers["sigma_of_base_deg"]
    assert numbers["tip_from_where_the_case_has_it_mm"] < 1.0
    (mount,) = found["others"]
    assert mount["name"] == "CauteryToStylus"
    assert len(found["residuals"]["leave_one_out_mm"]) == numbers["poses"] >= 30
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_hand_eye_of_a_realistic_case_is_within_its_tolerance(case, true_base):
    """Distortion and errors of encoders and calibrations are more than the predicted sigma."""
    allowed = yaml.safe_load((case / "expected.yaml").read_text())["registration"]
    base = transform_of(run_json("calibrate", "hand-eye", case, "--to-s", "30"))
    assert error_at_the_sensor_mm(case, base, true_base) < allowed["tolerance_mm"]
    assert np.degrees(base.angle_to(true_base)) < allowed["tolerance_deg"]


def test_hand_eye_rejects_a_robot_that_hardly_turned(case):
    error = refused("calibrate", "hand-eye", case, "--to-s", "1.2")
    assert re.search(r"1 poses .*; expected at least 4", error)


def test_time_finds_the_true_offset(case, tmp_path):
    saved = tmp_path / "clock.yaml"
    found = run_json("calibrate", "time", case, "--to-s", "20", "--save", saved)
    numbers = found["numbers"]
    assert numbers["interval_low_ms"] <= TRUE_LAG_MS <= numbers["interval_high_ms"]
    assert numbers[KEY] == pytest.approx(TRUE_LAG_MS, abs=1.0)
    assert found["transform"] is None and numbers["explained"] > 0.99
    assert yaml.safe_load(saved.read_text()) == {"clock": {KEY: numbers[KEY]}}


@pytest.mark.parametrize(("guess_ms", "status"), [(-400, 0), (400, 0), (-600, 1)])
def test_time_searches_half_a_second_around_the_first_guess(case, guess_ms, status):
    options = ["--to-s", "12", "--around-ms", guess_ms]
    found = run_json("calibrate", "time", case, *options, status=status)
    if status == 0:
        assert found["numbers"][KEY] == pytest.approx(TRUE_LAG_MS, abs=2.0)
    else:
        assert "end of the search" in found["reason"]


def test_time_does_not_accept_slow_motion(case, tmp_path):
    saved = tmp_path / "clock.yaml"
    span = ["--from-s", "26", "--to-s", "42"]
    printed = run("calibrate", "time", case, *span, "--save", saved, status=1).out
    assert "time  NOT ACCEPTED" in printed and "expected at most 5 ms" in printed
    assert not saved.exists()


def test_register_follows_the_manifest(case, true_base, tmp_path):
    saved, plot = tmp_path / "base.tfm", tmp_path / "base.png"
    found = run_json("calibrate", "robot-base", case, "--save", saved, "--plot", plot)
    base = transform_of(found)
    assert base.distance_mm_to(true_base) < 1.0
    assert np.degrees(base.angle_to(true_base)) < 0.5
    assert len(found["residuals"]["values"]) == 8 and found["residuals"]["unit"] == "mm"
    read = read_transform(saved, target="reference", source="robot_base")
    np.testing.assert_allclose(read.matrix, base.matrix, atol=1e-9)
    assert plot.read_bytes().startswith(b"\x89PNG")


def with_joints(
    case: Path, folder: Path, change: Callable[[Sequence[JointSample]], Iterable[JointSample]]
) -> Path:
    """Write the first 20 s of ``case`` with changed joints to ``folder``."""
    shutil.copytree(case, folder, ignore=shutil.ignore_patterns("*.mcap"))
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    manifest["recording"] = {"path": "tracking.mcap"}
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    recorded = islice(open_case(case).recorded_frames(), 800)
    write_recording(
        folder / "tracking.mcap",
        (replace(frame, joints=tuple(change(frame.joints))) for frame in recorded),
        robot_to_tracker_offset_ns=round(CLOCK_OFFSET_MS * 1e6),
        joint_states_topic="/joint_states",
    )
    return folder


def test_incomplete_joints_are_rejected(case, tmp_path):
    """Roll only turns the stylus in place: a fit with roll at 0 would be accepted."""

    def without_roll(samples: Sequence[JointSample]) -> Iterable[JointSample]:
        for sample in samples:
            others = {name: value for name, value in sample.as_mapping().items() if name != "roll"}
            yield JointSample(tuple(others), tuple(others.values()), sample.stamp)

    partial = with_joints(case, tmp_path / "partial", without_roll)
    for method in ("robot-base", "hand-eye", "time"):
        error = refused("calibrate", method, partial)
        assert "joint 'roll', which moves 'stylus', has no position" in error


def test_hand_eye_interpolates_joints_only_across_short_gaps(case, tmp_path):
    """Twelve joint samples per second are enough, five are not."""
    rms_mm = []
    for every in (1, 16):
        sparse = with_joints(case, tmp_path / str(every), every_nth(every))
        rms_mm.append(run_json("calibrate", "hand-eye", sparse)["numbers"]["rms_mm"])
    assert rms_mm[1] < 1.5 * rms_mm[0]
    sparse = with_joints(case, tmp_path / "40", every_nth(40))
    error = refused("calibrate", "hand-eye", sparse)
    assert re.search(r"none of \d+ joint samples is close in time to a valid pose", error)


def every_nth(nth: int) -> Callable[[Sequence[JointSample]], Iterable[JointSample]]:
    count = itertools.count()
    return lambda samples: (sample for sample in samples if next(count) % nth == 0)


def test_case_without_robot_is_rejected(tmp_path):
    small = write_small_case(tmp_path / "small")
    for method in ("robot-base", "hand-eye", "time"):
        assert re.search(r"has no (robot|joints)", refused("calibrate", method, small))
    error = refused("calibrate", "time", small, "--save", tmp_path / "lag.tfm")
    assert "wrong file type for a clock offset; expected .yaml" in error
