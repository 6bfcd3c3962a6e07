"""A few rows of the fault matrix with real processes."""

import pytest

pytest.importorskip("rclpy")

from benchmarks.faults.results import SAFE
from tests.benchmarks.bench_run import run

pytestmark = pytest.mark.long


def test_faults_are_injected_into_a_running_session(tmp_path):
    """Whole program: guard, tracker, controller. The limit is long, because the machine is busy."""
    rows = ["INVALID (live*", "NaN", "tool jumps 10 mm (live"]
    options = ["--trials", "1", "--constraint-hz", "100", "--stale-ms", "400", "--rows", *rows]
    done, verdicts = run("faults", tmp_path / "faults.json", *options, timeout_s=180)
    assert done.returncode == 0, done.stdout + done.stderr
    found = {row["fault"]: row for row in verdicts}
    assert {name: row["outcome"] for name, row in found.items()} == {
        "INVALID": SAFE,
        "NaN": SAFE,
        "tool jumps 10 mm": SAFE,
    }
    assert "not_finite" in found["NaN"]["reasons"]
    assert [row["trials"] for row in found.values()] == [1, 1, 1]
