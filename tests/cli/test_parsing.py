"""Usage errors: one line, a suggestion, exit status 2, and JSON with ``--json``."""

import json

import pytest

from app.cli.commands.bench import BENCHMARKS, MOVED
from tests.cli.command import refused


def test_json_behind_the_name_of_a_benchmark_is_not_of_the_command():
    error = refused("bench", "bogus", "--json", "x.json")
    assert error.startswith("marginguard bench: error: ")


@pytest.mark.parametrize(
    ("arguments", "suggestion"),
    [
        ("repaly", "did you mean 'replay'?"),
        ("calibrate pivto x", "did you mean 'pivot'?"),
        ("bench latncy", "did you mean 'latency'?"),
        ("tumor x.stl --units mmm", "did you mean 'mm'?"),
        ("replay x --reprot y", "did you mean '--report'?"),
        ("live --confg=live.yaml", "did you mean '--config'?"),
    ],
)
def test_misspelt_word_is_answered_with_similar_one(arguments, suggestion):
    assert suggestion in refused(*arguments.split())


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_benchmark_of_earlier_version_names_its_replacement(old, new, project_root):
    assert refused("bench", old, "--any") == (
        f"marginguard bench: error: {old}: is no longer a benchmark; expected {new}"
    )
    words = new.split()
    assert (
        words[2] in BENCHMARKS if words[0] == "marginguard" else (project_root / words[1]).is_file()
    )


def test_word_without_similar_one_gets_no_suggestion():
    error = refused("xyzzy")
    assert "invalid choice: 'xyzzy'; expected one of replay, " in error
    assert "did you mean" not in error


@pytest.mark.parametrize(
    "arguments",
    ["--json repaly", "info --json x --bogus", "info bench --json --bogus", "--json bench bogus"],
)
def test_usage_error_as_json(arguments):
    words = arguments.split()
    error = json.loads(refused(*words))["error"]
    assert (error["kind"], error["exit_status"]) == ("usage", 2)
    assert words[-1] in error["message"]


@pytest.mark.parametrize(
    "arguments",
    [
        "info /nowhere --json",
        "info /nowhere --js",
        "--js info /nowhere",
        "info /nowhere --package-dir bench --json",
        "--json convert /nowhere new",
    ],
)
def test_input_error_as_json(arguments, tmp_path, monkeypatch):
    (tmp_path / "bench").mkdir()
    monkeypatch.chdir(tmp_path)
    message = "/nowhere is not a case: no such folder"
    expected = {"message": message, "kind": "input", "exit_status": 2}
    assert json.loads(refused(*arguments.split()))["error"] == expected
