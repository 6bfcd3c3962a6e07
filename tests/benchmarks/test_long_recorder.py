"""The promise of the recorder, kept at twenty kills at random times."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")


def test_twenty_killed_recorders_lose_no_more_than_promised(tmp_path: Path) -> None:
    figures = tmp_path / "kills.json"
    command = [sys.executable, "-m", "app.cli", "bench", "record", "--kills", "20"]
    done = subprocess.run([*command, "--json", str(figures)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(json.loads(figures.read_text())) == 20
