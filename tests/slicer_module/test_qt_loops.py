"""Checks that run Qt's event loop, in a process of their own.

A loop would also call what windows of other tests have left behind, some of it deleted.
"""

from pathlib import Path

import pytest

from tests.forking import VIEW, run_forked

pytestmark = pytest.mark.slow

CHECKS = ("tests/slicer_module/qt_spinner_checks.py", "tests/slicer_module/ros2_panel_checks.py")


def run_checks(project_root: Path, *checks: str) -> None:
    """Run files of checks by pytest in one process; fail with its output."""
    command = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=short", *checks)
    done = run_forked(*command, modules=VIEW, folder=project_root)
    assert done.returncode == 0, done.stdout[-5000:]
    assert " passed" in done.stdout or " skipped" in done.stdout


def test_checks_with_a_loop_pass(project_root):
    run_checks(project_root, *CHECKS)
