"""Tests that run in forked workers: each once, and none is lost without a word."""

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

pytestmark = pytest.mark.slow

CONFTEST = """
    from tests.forked_workers import ForkedWorkers

    def pytest_collection_modifyitems(config, items):
        config.pluginmanager.register(ForkedWorkers(2, [3, len(items) - 3]))
"""
FIRST = """
    import warnings

    def test_first(tmp_path):
        warnings.warn("seen")

    def test_wrong():
        print("printed")
        assert 1 == 2

    def test_last():
        pass
"""


def run(folder: Path, project_root: Path, first: str, second: str) -> tuple[int, str]:
    """Exit status and output of pytest for two files of tests."""
    for name, text in (("conftest", CONFTEST), ("test_first", first), ("test_second", second)):
        (folder / f"{name}.py").write_text(dedent(text))
    command = ["-m", "pytest", "-c", "/dev/null", f"--rootdir={folder}", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [sys.executable, *command, "--junitxml", folder / "results.xml", folder],
        cwd=project_root,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


def test_each_test_runs_once_and_reports_come_back(tmp_path: Path, project_root: Path) -> None:
    status, output = run(tmp_path, project_root, FIRST, "def test_other():\n    pass")
    assert status == 1
    assert "1 failed, 3 passed, 1 warning" in output
    assert "UserWarning: seen" in output
    assert "printed" in output
    assert (tmp_path / "results.xml").read_text().count("<testcase") == 4


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), 9)", "os._exit(0)"])
def test_worker_that_dies_fails_the_run(tmp_path: Path, project_root: Path, end: str) -> None:
    second = f"import os\ndef test_dies():\n    {end}\ndef test_never():\n    pass"
    status, output = run(tmp_path, project_root, FIRST.replace("1 == 2", "2 == 2"), second)
    assert status == 1
    code = -9 if "kill" in end else 0
    assert f"worker ended with status {code} in test_second.py::test_dies" in output
