"""Cuts of the demo's case by the command line: a breach of the shaft, and a truncated recording."""

import pytest

from tests.cli.command import run, run_json
from tests.cut_case import write_cut_case
from tests.ros_domain import domain_id as domain_id
from tests.shipped_case import FRAMES, SHAFT, SHIPPED_CASE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shaft(tmp_path_factory):
    """Three seconds around the breach of the tool's shaft."""
    return write_cut_case(tmp_path_factory.mktemp("shaft") / "case", SHAFT["start_s"] - 1.0, 3.0)


def test_info_gives_number_of_frames_of_replay():
    (line,) = (line for line in run("info", SHIPPED_CASE).out.splitlines() if "  frames " in line)
    assert line.endswith(f"silences: 1, so a replay has {FRAMES} frames")


def test_replay_over_ros_at_another_rate_has_the_same_summary(shaft, domain_id):
    summary = run_json("replay", shaft, "--rate", "5")
    assert len(summary["breaches"]) == 1
    alone = run_json("replay", shaft, "--no-ros")
    assert summary | {"timing": None} == alone | {"timing": None}


def test_tip_only_replay_misses_breach_of_shaft(shaft):
    assert run_json("replay", shaft, "--no-ros", "--tip-only")["breaches"] == []


def test_complete_part_of_truncated_recording_is_used_with_a_note(tmp_path):
    case = write_cut_case(tmp_path / "case", 0.0, 20.0)
    recording = (case / "tracking.mcap").read_bytes()
    (case / "tracking.mcap").write_bytes(recording[: int(0.45 * len(recording))])
    summary = run_json("replay", case, "--no-ros")
    assert 100 < summary["frames"] < 500
    assert any("tracking.mcap" in note for note in summary["notes"])
