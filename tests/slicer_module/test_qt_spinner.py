"""The checks of Qt's loops run in a process of their own.

A loop would also call what windows of other tests have left behind, some of it deleted.
"""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

CHECKS = Path(__file__).with_name("qt_spinner_checks.py")


def test_other_threads_wake_the_loops_of_qt(project_root: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(CHECKS)]
    done = subprocess.run(command, cwd=project_root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-5000:]
    assert " passed" in done.stdout or " skipped" in done.stdout
