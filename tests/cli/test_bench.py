"""``marginguard bench`` runs in the current folder, with the code of the checkout."""

import json
import os
import sys
from pathlib import Path

import pytest

from app.cli.commands import bench
from tests.cli.command import refused
from tests.cli.small_case import write_small_case
from tests.python_process import run_python

pytestmark = pytest.mark.long

CHECKOUT = Path(__file__).resolve().parents[2]


def test_paths_are_relative_to_current_folder_and_code_is_of_checkout(tmp_path):
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "session.py").write_text("raise SystemExit(7)")
    write_small_case(tmp_path / "case")
    options = ("--steps", "100", "--case", "case", "--json", "figures.json")
    command = ("-P", "-m", "app.cli", "bench", "session", *options)
    done = run_python(
        *command, status=None, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(CHECKOUT)}
    )
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert sum(figures["states"].values()) > 400, done.stderr
    assert done.returncode == int(bool(figures["failures"]))
    assert {"cores", "date", "versions", "commit"} <= figures["machine"].keys()


@pytest.fixture
def started(monkeypatch, capsys):
    """A function that runs the process of ``marginguard bench``: exit status, output and errors."""

    def run(name, *options):
        monkeypatch.setattr(sys, "argv", ["benchmark", f"benchmarks.{name}", *options])
        with pytest.raises(SystemExit) as end:
            bench.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.mark.parametrize("name", ["replay", "session"])
def test_each_help_contains_command(name, started):
    status, printed, _ = started(name, "--help")
    assert status == 0
    assert printed.startswith(f"usage: marginguard bench {name} ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["session", "--case", "nowhere"],
            "'nowhere' is no case; expected a folder with a case.yaml",
        ),
        (["session", "--steps", "0"], "argument --steps: 0; expected 100 or more"),
        (["replay", "nowhere"], "'nowhere' is no case; expected a folder with a case.yaml"),
        (["replay", "--runs", "0"], "argument --runs: 0; expected 1 or more"),
        (
            ["replay", "--minutes", "-1"],
            "argument --minutes: -1; expected more than 0, at most 600",
        ),
        (
            ["closed_loop", "--json", "x.json", "--append"],
            "argument --append/--first-push: is gone; expected all --pushes in one run",
        ),
        (["closed_loop", "--contact"], "is gone; expected pytest tests/simulation/test_contact.py"),
        (["cohort", "--keep", "x"], "is gone; expected all --workers in one run"),
        (["fixture", "--tumors", "80", "19"], "argument --tumors: 19; expected 20 or more"),
    ],
)
def test_bad_options_give_one_error_line_and_no_figures(arguments, message, started):
    status, printed, error = started(*arguments)
    assert (status, printed) == (2, "")
    assert message in error.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (["view", "--json", "none/x.json"], "none/x.json"),
        (["fixture", "--plot=none/x.png"], "none/x.png"),
    ],
)
def test_file_that_cannot_be_written_is_refused_before_the_benchmark_starts(arguments, file):
    assert f"{file} cannot be written: parent" in refused("bench", *arguments)


@pytest.mark.parametrize(
    ("name", "peer"), [("view", "playwright"), ("images", "playwright"), ("fixture", "coal")]
)
def test_missing_peer_is_reported_in_one_line(name, peer, tmp_path):
    missing = f"raise ModuleNotFoundError('gone', name={peer!r})"
    (tmp_path / f"{peer}.py").write_text(missing)
    command = ("-P", "-m", "app.cli", "bench", name)
    done = run_python(
        *command,
        status=None,
        env={**os.environ, "PYTHONPATH": os.pathsep.join((str(CHECKOUT), str(tmp_path)))},
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert "'.[test]'" in done.stderr
    assert f"this benchmark needs {peer}" in done.stderr
    assert len(done.stderr.splitlines()) == 1
