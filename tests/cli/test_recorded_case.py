"""The case of the demo: each kind of replay finds what its expected.yaml lists."""

import json
import os
import shutil
import subprocess
import sys

import pytest
import yaml

from app.cli.main import main
from tests.ros_domain import domain_id as domain_id


@pytest.fixture(scope="module")
def case(project_root):
    return project_root / "data" / "recorded_case"


@pytest.fixture(scope="module")
def report(case, tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded")
    assert main(["replay", str(case), "--no-ros", "--report", str(out)]) == 0
    return out


def test_every_check_of_the_case_passes(report, case):
    summary = json.loads((report / "summary.json").read_text())
    expected = yaml.safe_load((case / "expected.yaml").read_text())
    intervals = expected["breaches"]["intervals"]
    assert len(summary["breaches"]) == len(intervals) == 3
    for found, true in zip(summary["breaches"], intervals, strict=True):
        assert found["start_s"] == pytest.approx(true["start_s"], abs=0.040)
        assert found["end_s"] == pytest.approx(true["end_s"], abs=0.040)
    assert [check["result"] for check in summary["expected"]] == ["pass"] * len(summary["expected"])
    assert sum(interval["shaft_only"] for interval in intervals) == 1


def test_info_gives_number_of_frames_of_replay(report, case, capsys):
    assert main(["info", str(case)]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if "  frames " in line)
    frames = json.loads((report / "summary.json").read_text())["frames"]
    assert line.endswith(f"silences: 1, so a replay has {frames} frames")


def test_report_has_all_files(report):
    assert sorted(path.name for path in report.iterdir()) == [
        "analysis.json",
        "coverage.svg",
        "distances.svg",
        "margin.csv",
        "margin.png",
        "report.html",
        "scene.png",
        "summary.json",
    ]


def test_table_over_ros_at_another_rate_has_same_bytes(report, case, tmp_path, domain_id):
    options = ["--rate", "500", "--report", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-m", "app.cli", "replay", str(case), *options],
        capture_output=True,
        text=True,
        env=dict(os.environ),
        check=False,
    )
    assert done.returncode == 0, done.stderr
    table = (tmp_path / "out" / "margin.csv").read_bytes()
    assert table == (report / "margin.csv").read_bytes()


def test_tip_only_replay_misses_breach_of_shaft(case, capsys):
    assert main(["replay", str(case), "--no-ros", "--tip-only", "--json"]) == 1
    assert len(json.loads(capsys.readouterr().out)["breaches"]) == 2


def test_complete_part_of_truncated_recording_is_used_with_a_note(case, tmp_path, capsys):
    copy = tmp_path / "case"
    shutil.copytree(case, copy)
    recording = (copy / "tracking.mcap").read_bytes()
    (copy / "tracking.mcap").write_bytes(recording[: int(0.45 * len(recording))])
    manifest = yaml.safe_load((copy / "case.yaml").read_text())
    del manifest["recording"]["sha256"], manifest["expected"]
    (copy / "case.yaml").write_text(yaml.safe_dump(manifest))
    assert main(["replay", str(copy), "--no-ros", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert 1000 < summary["frames"] < 3700
    assert any("tracking.mcap" in note for note in summary["notes"])
