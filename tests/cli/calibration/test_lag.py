"""``calibrate lag``: the offset between a recording and another signal of its motion."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from app.case import TrackingFrame
from app.files.numbers import read_signal
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from tests.cli.calibration.recordings import write_igsio
from tests.cli.command import run, run_json
from tests.registration.time_signals import Motion, sample_times

pytestmark = pytest.mark.slow

LAG_S = -0.0648
"""Lag of the video's clock, as on a recording of a water tank that PLUS publishes."""


@pytest.fixture
def motion() -> Motion:
    return Motion(np.random.default_rng(3), 3, 12.0)


@pytest.fixture
def recording(tmp_path: Path, motion: Motion) -> Path:
    rng = np.random.default_rng(4)
    times = sample_times(rng, 40.0, 25.0) + 100.0
    positions = motion(times) + rng.normal(0.0, 0.1, (len(times), 3))
    frames = []
    for time, position in zip(times, positions, strict=True):
        stamp = Stamp(round(time * 1e9))
        pose = Transform("tracker", "probe", np.eye(3), position)
        frames.append(TrackingFrame(stamp, (TrackedTransform(pose, stamp, TrackingStatus.OK),)))
    return write_igsio(tmp_path / "probe.igs.mha", frames)


def table(path: Path, motion: Motion, *, columns: np.ndarray, noise: float = 0.4) -> Path:
    """Values in pixels by a video at 30 Hz: the motion along ``columns`` (3, d)."""
    rng = np.random.default_rng(5)
    times = sample_times(rng, 30.0, 25.0) + 100.0
    values = 300.0 + 6.0 * motion(times) @ columns
    values += rng.normal(0.0, noise, values.shape)
    rows = np.column_stack([times + LAG_S, values])
    np.savetxt(path, rows, delimiter=",", header="time_s,line_px", comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize("columns", [[[0.2], [0.9], [-0.4]], np.eye(3, 4) + 0.1])
def test_line_in_a_video_gives_the_offset_with_its_interval(tmp_path, recording, motion, columns):
    """Also with more values than the tracker has: then the tracker is fitted to the video."""
    video, saved = table(tmp_path / "v.csv", motion, columns=np.array(columns)), tmp_path / "l.yaml"
    found = run_json("calibrate", "lag", recording, "--other", video, "--save", saved)
    numbers = found["numbers"]
    assert numbers["offset_ms"] == pytest.approx(1e3 * LAG_S, abs=1.5)
    assert numbers["interval_low_ms"] < numbers["offset_ms"] < numbers["interval_high_ms"]
    assert numbers["interval_high_ms"] - numbers["interval_low_ms"] < 6.0
    assert yaml.safe_load(saved.read_text())["offset_ms"] == numbers["offset_ms"]


def test_recording_is_its_own_reference(recording):
    found = run_json("calibrate", "lag", recording, "--other", recording)
    assert found["numbers"]["offset_ms"] == pytest.approx(0.0, abs=1e-3)


def test_signal_of_another_motion_is_not_accepted(tmp_path, recording):
    other = Motion(np.random.default_rng(9), 3, 12.0)
    video = table(tmp_path / "v.csv", other, columns=np.array([[1.0], [0.0], [0.0]]))
    assert "NOT ACCEPTED" in run("calibrate", "lag", recording, "--other", video, status=1).out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no numbers; expected lines of a time in s and values"),
        ("time,x\n", "holds no numbers"),
        ("1,2\n2\n", "line 2 has 1 columns; expected 2"),
        ("1,2\n2,x\n", "line 2: 'x' is not a number"),
        ("1,2\nnan,3\n", "line 2: time 'nan' is not a finite number"),
    ],
)
def test_malformed_table_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_signal(path)
