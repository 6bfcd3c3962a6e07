"""``calibrate pivot`` and ``calibrate spin``."""

import re

import numpy as np
import pytest

from app.files import read_transform
from app.geometry import TrackingStatus
from tests.cli.calibration.recordings import (
    TIP_MM,
    frames,
    pivoting,
    spinning,
    write_bag,
    write_igsio,
    write_mcap,
)
from tests.cli.command import refused, run, run_json

pytestmark = pytest.mark.slow

LOST = {5: TrackingStatus.INVALID, 30: TrackingStatus.OUT_OF_VIEW, 31: TrackingStatus.MISSING}


@pytest.mark.parametrize(
    ("name", "write"), [("p.igs.mha", write_igsio), ("p.mcap", write_mcap), ("p", write_bag)]
)
def test_pivot_finds_the_tip_in_every_recording_format(tmp_path, name, write):
    recording = write(tmp_path / name, frames(pivoting(np.random.default_rng(1), 80, 60.0), LOST))
    tip = tmp_path / "StylusTipToStylus.tfm"
    found = run_json("calibrate", "pivot", recording, "--save", tip)
    assert found["transform"]["name"] == "StylusTipToStylus"
    matrix = np.reshape(found["transform"]["matrix"], (4, 4))
    np.testing.assert_allclose(matrix[:3, 3], TIP_MM, atol=0.15)
    np.testing.assert_allclose(matrix[:3, 2], TIP_MM / np.linalg.norm(TIP_MM), atol=1e-3)
    assert found["numbers"]["samples"] == 77
    assert found["numbers"]["poses"] >= 40
    assert found["notes"] == ["3 of 80 frames left out: 2 missing, 1 invalid"]
    assert found["elapsed_s"] > 0.0
    saved = read_transform(tip, target="stylus", source="stylus_tip")
    np.testing.assert_allclose(saved.matrix, matrix, atol=1e-9)


def test_pivot_over_a_narrow_cone_is_not_accepted_and_not_saved(tmp_path):
    recorded = frames(pivoting(np.random.default_rng(2), 120, 20.0), {})
    recording = write_igsio(tmp_path / "p.igs.mha", recorded)
    tip = tmp_path / "tip.yaml"
    plot = tmp_path / "tip.png"
    printed = run("calibrate", "pivot", recording, "--save", tip, "--plot", plot, status=1)
    assert "NOT ACCEPTED" in printed.out
    assert "the shaft swings over" in printed.out and "expected at least 30" in printed.out
    assert f"{tip} is not written: not accepted" in printed.err
    assert not tip.exists()
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_spin_finds_the_shaft_and_keeps_the_tip_position(tmp_path):
    shaft = np.array([0.1, 0.05, 1.0]) / np.linalg.norm([0.1, 0.05, 1.0])
    recorded = frames(spinning(np.random.default_rng(3), 60, shaft), {})
    recording = write_mcap(tmp_path / "s.mcap", recorded)
    tip, spun = tmp_path / "tip.txt", tmp_path / "spun.yaml"
    pose = np.eye(4)
    pose[:3, 3] = TIP_MM
    np.savetxt(tip, pose)
    found = run_json("calibrate", "spin", recording, "--tip-from", tip, "--save", spun)
    matrix = np.reshape(found["transform"]["matrix"], (4, 4))
    np.testing.assert_allclose(matrix[:3, 3], TIP_MM, atol=1e-9)
    assert np.degrees(np.arccos(matrix[:3, 2] @ shaft)) < 0.15
    assert found["residuals"]["unit"] == "deg"
    saved = read_transform(spun, target="stylus", source="stylus_tip")
    np.testing.assert_allclose(saved.matrix, matrix, atol=1e-12)


def test_spin_requires_the_tip(tmp_path):
    shaft = np.array([0.0, 0.0, 1.0])
    recorded = frames(spinning(np.random.default_rng(4), 20, shaft), {})
    recording = write_mcap(tmp_path / "s.mcap", recorded)
    expected = "tip of 'stylus': not known; expected --tip-from FILE"
    assert expected in refused("calibrate", "spin", recording)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--tool", "probe"],
            "--tool 'probe' is not in .*; expected one of tracker, reference, stylus$",
        ),
        (
            ["--reference", "probe"],
            "--reference 'probe' is not in .*; expected one of tracker, reference",
        ),
        (
            ["--tool", "stylus", "--reference", "stylus"],
            "--reference is 'stylus', the tool itself; expected another frame",
        ),
        (
            ["--from-s", "100"],
            "no frame between 100 and inf s; expected .* recording, which ends at 3.95 s",
        ),
        (["--to-s", "0.2"], "5 poses for a pivot, of 5 samples that turn by at most 10"),
        (["--save", "tip.h5"], r"tip.h5 is not a transform file; expected .yaml, .yml, .tfm, .txt"),
        (["--plot", "tip.pdf"], "tip.pdf: wrong file type for a plot; expected .png"),
    ],
)
def test_bad_input_gives_one_error_line_and_status_2(tmp_path, options, message):
    recorded = frames(pivoting(np.random.default_rng(1), 80, 60.0), {})
    recording = write_igsio(tmp_path / "p.igs.mha", recorded)
    line = refused("calibrate", "pivot", recording, *options)
    assert re.search(message, line), line


def test_to_s_restricts_the_recording(tmp_path):
    good = pivoting(np.random.default_rng(5), 80, 60.0)
    recorded = frames([*good, *good[::-1]], dict.fromkeys(range(80, 160), TrackingStatus.INVALID))
    recording = write_igsio(tmp_path / "p.igs.mha", recorded)
    found = run_json("calibrate", "pivot", recording, "--to-s", "3.95")
    assert found["numbers"]["samples"] == 80 and found["notes"] == []


def test_reference_may_be_the_tracker(tmp_path):
    recorded = frames(pivoting(np.random.default_rng(6), 80, 60.0), {})
    recording = write_mcap(tmp_path / "p.mcap", recorded)
    found = run_json("calibrate", "pivot", recording, "--reference", "tracker")
    matrix = np.reshape(found["transform"]["matrix"], (4, 4))
    np.testing.assert_allclose(matrix[:3, 3], TIP_MM, atol=0.2)


def test_path_that_is_not_a_recording_is_rejected(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    for path in (tmp_path / "notes.txt", tmp_path, tmp_path / "none.mcap"):
        assert str(path) in refused("calibrate", "pivot", path)
