"""Checks that run Qt's event loop, in a process of their own.

A loop would also call what windows of other tests have left behind, some of it deleted.
"""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parent


@pytest.mark.parametrize("checks", ["qt_spinner_checks.py", "ros2_panel_checks.py"])
def test_checks_with_a_loop_pass(project_root: Path, checks: str) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", FOLDER / checks]
    done = subprocess.run(command, cwd=project_root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-5000:]
    assert " passed" in done.stdout or " skipped" in done.stdout
