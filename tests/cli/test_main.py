import json
import os
import subprocess
import sys

import pytest

from app.cli.main import COMMANDS, main
from tests.cli.small_case import write_small_case


@pytest.mark.parametrize("arguments", [[], *[[name] for name in COMMANDS]])
def test_help_imports_no_heavy_package(arguments, project_root):
    code = (
        "import sys\n"
        "from app.cli.main import main\n"
        "try:\n"
        f"    main([*{arguments!r}, '--help'])\n"
        "except SystemExit as stop:\n"
        "    print(stop.code, sorted({'numpy', 'scipy', 'rich', 'rclpy'} & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=project_root
    )
    assert done.stdout.splitlines()[-1] == "0 []"


def test_closed_standard_output_gives_status_141(project_root, tmp_path):
    case = write_small_case(tmp_path / "case")
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "app.cli", "info", str(case)],
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
        cwd=project_root,
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


def test_unknown_command_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["repaly"])
    assert stop.value.code == 2
    assert "invalid choice: 'repaly'" in capsys.readouterr().err


def test_package_is_found_in_given_folder(tmp_path, capsys):
    (tmp_path / "packages/shapes").mkdir(parents=True)
    case = write_small_case(
        tmp_path / "case",
        lambda manifest: manifest["tumor"]["mesh"].update(path="package://shapes/tumor.stl"),
    )
    (case / "tumor.stl").rename(tmp_path / "packages/shapes/tumor.stl")
    for folder in ("packages", "packages/shapes"):
        assert main(["info", str(case), "--package-dir", str(tmp_path / folder)]) == 0
    named = f"shapes={tmp_path / 'packages/shapes'}"
    assert main(["info", str(case), "--package-dir", named]) == 0
    with pytest.raises(SystemExit):
        main(["info", str(case), "--package-dir", "shapes=/nowhere"])
    assert "'/nowhere': no such folder" in capsys.readouterr().err
    assert main(["info", str(case)]) == 2
    assert "package 'shapes' not found (no --package-dir)" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(["info", str(case), "--package-dir", str(tmp_path / "none")])
    assert stop.value.code == 2
    assert "none': no such folder" in capsys.readouterr().err


def test_make_case_refuses_current_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["make-case", "."]) == 2
    assert ". is the current folder; expected another one" in capsys.readouterr().err


@pytest.mark.parametrize("seed", ["-1", "x", "1.5"])
def test_invalid_seed_is_bad_input(tmp_path, capsys, seed):
    with pytest.raises(SystemExit) as stop:
        main(["make-case", str(tmp_path / "case"), "--seed", seed])
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert f"argument --seed: invalid seed '{seed}'; expected an integer of 0 or more" in error


def test_replay_without_ros_loads_neither_rclpy_nor_slow_parts_of_scipy(tmp_path, project_root):
    case = write_small_case(tmp_path / "case")
    code = (
        "import sys\n"
        "from app.cli.main import main\n"
        f"status = main(['replay', {str(case)!r}, '--no-ros'])\n"
        "slow = {'rclpy', 'matplotlib', 'scipy.sparse', 'scipy.spatial', 'scipy.special'}\n"
        "print(status, *slow & set(sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=project_root
    )
    assert done.stdout.splitlines()[-1] == "0"
    printed = [line for line in done.stderr.splitlines() if not line.startswith("compiling for")]
    assert printed == [], "expected no progress bar without a terminal"


def test_info_counts_frames_and_samples(tmp_path, capsys):
    case = write_small_case(tmp_path / "case")
    assert main(["info", str(case), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["frames"] == 40
    assert found["duration_s"] == pytest.approx(1.95)
    assert found["transforms"] == [
        {"target": "tracker", "source": source, "samples": 40, "statuses": {"OK": 40}}
        for source in ("needle", "rod")
    ]
    assert main(["info", str(case)]) == 0
    assert "tracker -> rod: 40 OK" in capsys.readouterr().out


def test_converted_case_replays_to_same_table(tmp_path, capsys):
    case = write_small_case(tmp_path / "case")
    assert main(["convert", str(case), str(tmp_path / "mcap")]) == 0
    for name in ("case", "mcap"):
        report = str(tmp_path / f"{name}-report")
        assert main(["replay", str(tmp_path / name), "--no-ros", "--report", report]) == 0
    first, second = (
        (tmp_path / f"{name}-report" / "margin.csv").read_text() for name in ("case", "mcap")
    )
    assert first == second
    assert main(["convert", str(case), str(tmp_path / "mcap")]) == 2
    assert "already exists; refusing to overwrite it" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ["convert", "case", ""],
        ["make-case", ""],
        ["info", ""],
        ["live", "--config", "live.yaml", "--constraint-hz", "nan"],
        ["live", "--config", "live.yaml", "--constraint-hz", "1000.1"],
        ["live", "--config", "live.yaml", "--constraint-hz", "0"],
        ["live", "--config", "live.yaml", "--constraint-hz", "fast"],
        ["calibrate", "pivot", "case", "--max-age-ms", "x"],
        ["calibrate", "pivot", "case", "--max-age-ms", "1e308"],
        ["calibrate", "pivot", "case", "--max-age-ms", "-1"],
        ["calibrate", "pivot", "case", "--from-s", "nan"],
        ["calibrate", "pivot", "case", "--tool", ""],
        ["calibrate", "pivot", "case", "--reference", ""],
        ["calibrate", "landmarks", "case", "--phantom", ""],
        ["calibrate", "time", "case", "--around-ms", "1e308"],
        ["calibrate", "time", "case", "--around-ms", "nan"],
    ],
)
def test_invalid_value_of_an_option_is_shown_with_what_is_expected(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    error_text = capsys.readouterr().err.splitlines()[-1]
    assert (arguments[-1] or "empty") in error_text
    assert "expected" in error_text
    assert "_" not in error_text.partition("argument")[2].replace(
        "--", ""
    )  # no name of a Python function


@pytest.mark.parametrize("arguments", [["info"], ["calibrate", "pivot"]])
def test_debug_prints_traceback(arguments, tmp_path, capsys):
    assert main([*arguments, str(tmp_path / "none"), "--debug"]) == 2
    error_text = capsys.readouterr().err
    assert error_text.startswith("Traceback")
    assert error_text.splitlines()[-1].startswith("marginguard: error: ")


def test_long_error_is_shortened(capsys):
    assert main(["info", "/" + 5000 * "x"]) == 2
    error_text = capsys.readouterr().err
    assert error_text.startswith("marginguard: error: /xxx")
    assert error_text.endswith("xxx is not a case: no such folder\n")
    assert " ... " in error_text
    assert len(error_text) < 600


def test_invalid_rate_is_reported_before_case_is_opened(capsys):
    assert main(["replay", "nowhere", "--no-ros", "--rate", "nan"]) == 2
    assert "rate of a replay is nan; expected 0.001 to 1000" in capsys.readouterr().err
