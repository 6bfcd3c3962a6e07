"""The command line as a whole: what a command loads, options that all have, errors, conversion."""

import json
import os

import pytest

from app.cli.main import COMMANDS, MOVED
from tests.cli.command import margin_table, refused, run, run_json
from tests.cli.small_case import write_small_case
from tests.forking import run_forked
from tests.python_process import run_python

pytestmark = pytest.mark.slow

LOADED = """
import contextlib, json, sys
from app.cli.main import main

heavy, help = {"numpy", "scipy", "rich", "rclpy"}, {}
for command in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(sys.stderr):
        try:
            main([*command, "--help"])
        except SystemExit as stop:
            help[" ".join(command)] = [stop.code, *heavy & {*sys.modules}]
print(json.dumps(help))
slow = {"rclpy", "matplotlib", "scipy.sparse", "scipy.spatial", "scipy.special"}
print("after help", file=sys.stderr)
status = main(["replay", sys.argv[2], "--no-ros"])
print(json.dumps([status, *slow & {*sys.modules}]))
"""


@pytest.fixture
def case(tmp_path):
    return write_small_case(tmp_path / "case")


def test_help_and_replay_import_no_package_that_they_do_not_need(project_root, case):
    """Help loads no heavy package; a replay without ROS neither rclpy nor slow parts of scipy."""
    replaced = [new.split()[:2] for new in MOVED.values() if new.split()[1].islower()]
    commands = [[], *[[name] for name in COMMANDS], *replaced]
    done = run_python("-c", LOADED, json.dumps(commands), case, cwd=project_root)
    helps, *_, replay = done.stdout.splitlines()
    assert json.loads(helps) == {" ".join(command): [0] for command in commands}
    assert json.loads(replay) == [0]
    errors = done.stderr.partition("after help\n")[2].splitlines()
    printed = [line for line in errors if not line.startswith("compiling for")]
    assert printed == [], "expected no progress bar without a terminal"


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_command_of_earlier_version_names_its_replacement(old, new):
    problem = f"{old}: is part of {new.split()[0]}; expected marginguard {new}"
    assert refused(old, "--any", "argument") == f"marginguard: error: {problem}"
    assert json.loads(refused("--json", old))["error"]["message"].endswith(problem)
    words = [word for word in new.split() if word.islower() and not word.startswith("-")]
    assert f"usage: marginguard {' '.join(words)} " in run(*words, "--help").out


def test_closed_standard_output_gives_status_141(case):
    reader, writer = os.pipe()
    os.close(reader)
    done = run_forked("-m", "app.cli", "info", case, stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_package_is_found_in_given_folder(tmp_path):
    packages, shapes = tmp_path / "packages", tmp_path / "packages/shapes"
    shapes.mkdir(parents=True)
    path = {"path": "package://shapes/tumor.stl"}
    case = write_small_case(
        tmp_path / "case", lambda manifest: manifest["tumor"]["mesh"].update(path)
    )
    (case / "tumor.stl").rename(shapes / "tumor.stl")
    for folder in (packages, shapes, f"shapes={shapes}"):
        run("info", case, "--package-dir", folder)
    for folder, problem in (
        ("shapes=/nowhere", "'/nowhere': no such folder"),
        (tmp_path / "none", "none': no such folder"),
    ):
        assert problem in refused("info", case, "--package-dir", folder)
    assert "package 'shapes' not found (no --package-dir)" in refused("info", case)


def test_make_case_refuses_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ". is the current folder; expected another one" in refused("make-case", ".")


@pytest.mark.parametrize("seed", ["-1", "x", "1.5"])
def test_invalid_seed_is_bad_input(tmp_path, seed):
    error = refused("make-case", tmp_path / "case", "--seed", seed)
    assert f"argument --seed: invalid seed '{seed}'; expected an integer of 0 or more" in error


def test_info_counts_frames_and_samples(case):
    found = run_json("info", case)
    assert found["frames"] == 40
    assert found["duration_s"] == pytest.approx(1.95)
    assert found["transforms"] == [
        {"target": "tracker", "source": source, "samples": 40, "statuses": {"OK": 40}}
        for source in ("needle", "rod")
    ]
    assert "tracker -> rod: 40 OK" in run("info", case).out


def test_converted_case_replays_to_same_table(case, tmp_path):
    mcap = tmp_path / "mcap"
    run("convert", case, mcap)
    table = margin_table(case)
    assert table.count(b"\n") == 41
    assert margin_table(mcap) == table
    assert "already exists; refusing to overwrite it" in refused("convert", case, mcap)


@pytest.mark.parametrize(
    "arguments",
    [
        *(["convert", "case", ""], ["make-case", ""], ["info", ""]),
        *(
            ["live", "--config", "live.yaml", "--constraint-hz", value]
            for value in ("nan", "1000.1", "0", "fast")
        ),
        *(
            ["calibrate", "pivot", "case", *option.split(" ")]
            for option in (
                *("--max-age-ms x", "--max-age-ms 1e308", "--max-age-ms -1", "--max-age-ms nan"),
                *("--from-s nan", "--tool ", "--reference "),
            )
        ),
        ["calibrate", "landmarks", "case", "--phantom", ""],
        ["calibrate", "time", "case", "--around-ms", "1e308"],
        ["calibrate", "time", "case", "--around-ms", "nan"],
        ["replay", "case", "--no-ros", "--report", ""],
    ],
)
def test_invalid_value_of_an_option_is_shown_with_what_is_expected(arguments):
    error = refused(*arguments)
    assert (arguments[-1] or "empty") in error
    assert "expected" in error
    names = error.partition("argument")[2].replace("--", "")
    assert "_" not in names  # no name of a Python function


@pytest.mark.parametrize("arguments", [["info"], ["calibrate", "pivot"], ["replay"]])
def test_debug_prints_traceback(arguments, tmp_path):
    error = run(*arguments, tmp_path / "none", "--debug", status=2).err
    assert error.startswith("Traceback")
    assert error.splitlines()[-1].startswith("marginguard: error: ")


def test_long_error_is_shortened():
    error = refused("info", "/" + 5000 * "x")
    assert error.startswith("marginguard: error: /xxx")
    assert error.endswith("xxx is not a case: no such folder")
    assert " ... " in error
    assert len(error) < 600


def test_invalid_rate_is_reported_before_case_is_opened():
    error = refused("replay", "nowhere", "--no-ros", "--rate", "nan")
    assert "rate of a replay is nan; expected 0.001 to 1000" in error


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--tip-only"], "--tip-only is given; expected one CASE"),
        (["--volume", "x.nrrd"], "--volume is given; expected one CASE, or --live"),
        (["--render", "client"], "--render is given; expected one CASE, or --live"),
        (["--audit", "x"], "--audit is given; expected --config"),
        (["--max-upload-mb", "4097"], "'4097' MB; expected 0 to 4096"),
    ],
)
def test_view_refuses_option_that_a_folder_of_cases_does_not_have(tmp_path, options, problem):
    assert problem in refused("view", tmp_path, *options)


def test_view_refuses_folder_that_is_neither_case_nor_library(tmp_path):
    (tmp_path / "notes.txt").touch()
    expected = "--max-upload-mb is given; expected a folder of cases"
    assert expected in refused("view", tmp_path, "--max-upload-mb", "0")
    assert "is not a case" in refused("view", tmp_path)
