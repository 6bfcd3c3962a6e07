"""Usage errors: one line, a suggestion, exit status 2, and JSON with ``--json``."""

import json

import pytest

from app.cli.main import main


def test_json_behind_the_name_of_a_benchmark_is_not_of_the_command(capsys):
    error = usage_error(["bench", "bogus", "--json", "x.json"], capsys)
    assert error.startswith("marginguard bench: error: ")


def usage_error(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize(
    ("arguments", "suggestion"),
    [
        (["repaly"], "did you mean 'replay'?"),
        (["calibrate", "pivto", "x"], "did you mean 'pivot'?"),
        (["bench", "kinematic"], "did you mean 'kinematics'?"),
        (["tumor", "x.stl", "--units", "mmm"], "did you mean 'mm'?"),
        (["replay", "x", "--reprot", "y"], "did you mean '--report'?"),
        (["live", "--confg=live.yaml"], "did you mean '--config'?"),
    ],
)
def test_misspelt_word_is_answered_with_similar_one(arguments, suggestion, capsys):
    assert suggestion in usage_error(arguments, capsys)


def test_word_without_similar_one_gets_no_suggestion(capsys):
    error = usage_error(["xyzzy"], capsys)
    assert "invalid choice: 'xyzzy'; expected one of replay, " in error
    assert "did you mean" not in error


@pytest.mark.parametrize(
    "arguments",
    [
        ["--json", "repaly"],
        ["info", "--json", "x", "--bogus"],
        ["info", "bench", "--json", "--bogus"],
        ["--json", "bench", "bogus"],
    ],
)
def test_usage_error_as_json(arguments, capsys):
    error = json.loads(usage_error(arguments, capsys))["error"]
    assert (error["kind"], error["exit_status"]) == ("usage", 2)
    assert arguments[-1] in error["message"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "/nowhere", "--json"],
        ["info", "/nowhere", "--js"],
        ["--js", "info", "/nowhere"],
        ["info", "/nowhere", "--package-dir", "bench", "--json"],
        ["--json", "convert", "/nowhere", "new"],
    ],
)
def test_input_error_as_json(arguments, capsys, tmp_path, monkeypatch):
    (tmp_path / "bench").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert json.loads(captured.err)["error"] == {
        "message": "/nowhere is not a case: no such folder",
        "kind": "input",
        "exit_status": 2,
    }
