"""A few rows of the fault matrix with real processes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from benchmarks.faults.results import SAFE

pytestmark = pytest.mark.long


def test_faults_are_injected_into_a_running_session(tmp_path: Path, project_root: Path) -> None:
    """Whole program: guard, tracker, controller. The limit is long, because the machine is busy."""
    path = tmp_path / "faults.json"
    rows = ["INVALID (live*", "NaN", "tool jumps 10 mm (live"]
    options = ["--trials", "1", "--constraint-hz", "100", "--stale-ms", "400"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.faults", *options, "--json", str(path), "--rows", *rows],
        cwd=project_root,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = {row["fault"]: row for row in json.loads(path.read_text())["rows"]}
    assert {name: row["outcome"] for name, row in found.items()} == {
        "INVALID": SAFE,
        "NaN": SAFE,
        "tool jumps 10 mm": SAFE,
    }
    assert "not_finite" in found["NaN"]["reasons"]
    assert [row["trials"] for row in found.values()] == [1, 1, 1]
