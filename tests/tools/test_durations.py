"""The tool that lists the most expensive tests, on real runs of pytest."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools import durations

pytestmark = pytest.mark.slow

TESTS = """
import time

class TestClass:
    def test_rests(self):
        time.sleep(0.3)

def test_is_quick():
    pass
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with one test file, and ``run.xml``: the JUnit XML file of its run."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "tests").mkdir()
    (folder / "tests" / "test_some.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-q", "tests", "--junitxml=run.xml"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return folder


@pytest.fixture
def run(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The JUnit XML file; the project has earlier times."""
    monkeypatch.setattr(durations, "ROOT", project)
    record = tmp_path / "durations.csv"
    record.write_text("file,seconds\ntests/test_gone.py,9.0\ntests/test_some.py,0.1\n")
    monkeypatch.setattr(durations, "RECORDED", record)
    return project / "run.xml"


def test_most_expensive_file_and_test_come_first_with_share_and_record(run, capsys):
    assert durations.main([str(run)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("2 tests in 1 files")
    assert lines[3].split()[1:] == ["100.0%", "0.1", "tests/test_some.py"]
    assert lines[6].endswith("tests/test_some.py::test_rests")
    assert float(lines[6].split()[0]) >= 0.3


def test_record_replaces_what_ran_and_forgets_what_is_gone(run):
    assert durations.main([str(run), "--record"]) == 0
    header, row = durations.RECORDED.read_text().splitlines()
    name, seconds = row.split(",")
    assert (header, name) == ("file,seconds", "tests/test_some.py")
    assert float(seconds) >= 0.3


@pytest.mark.parametrize("content", [None, "", "<testsuite>"])
def test_unreadable_run_is_one_line(tmp_path, capsys, content):
    path = tmp_path / "run.xml"
    if content is not None:
        path.write_text(content)
    assert durations.main([str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_file_that_takes_longer_than_its_tier_is_named(run, monkeypatch):
    monkeypatch.setattr(durations, "FAST_S", 1.0)
    assert durations.misplaced({"tests/test_some.py": 0.9}) == []
    (line,) = durations.misplaced({"tests/test_some.py": 1.1})
    assert "mark it slow" in line
