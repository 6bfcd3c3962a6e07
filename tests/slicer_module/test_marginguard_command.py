"""``marginguard slicer`` with a test double of Slicer: a script that prints its arguments."""

import json
import os
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from app.cli.commands.slicer import HOOK_DONE, slicer_environment
from app.cli.main import main
from tests.python_process import run_python

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
MODULES = [str(ROOT / "slicer_module" / name) for name in ("MarginGuard", "ROS2")]
OURS = f"{sys.version_info.major}.{sys.version_info.minor}"
SLICER_DOUBLE = f"""#!{sys.executable} -S
# TEST DOUBLE of the program of desktop Slicer.
import json, os, sys
if sys.argv[1:] == ["--version"]:
    sys.exit(print("Slicer 5.8.1"))
print(json.dumps({{"arguments": sys.argv[1:], "environment": dict(os.environ)}}))
sys.exit(7)
"""


@pytest.fixture
def install(tmp_path):
    """``install(version)`` makes a folder like Slicer's, with a Python of that version."""

    def make(version=f"Python {OURS}.4", where="bin"):
        program = tmp_path / "Slicer-5" / "Slicer"
        (program.parent / where).mkdir(parents=True, exist_ok=True)
        program.write_text(SLICER_DOUBLE)
        program.chmod(0o755)
        if version is not None:
            python = program.parent / where / "PythonSlicer"
            python.write_text(f"#!/bin/sh\necho '{version}'\n")
            python.chmod(0o755)
        return program

    return make


def started(program, *arguments, **environment):
    command = ("-m", "app.cli", "slicer", "--slicer", program, *arguments)
    return run_python(*command, status=None, cwd=ROOT, env={**os.environ, **environment})


def test_slicer_is_started_with_the_modules_and_the_environment(install):
    done = started(
        install(),
        "--",
        "--no-splash",
        "scene.mrb",
        PYTHONPATH="/mine",
        LD_LIBRARY_PATH="/lib/of/mine",
    )
    assert done.returncode == 7, done.stderr  # the status of Slicer
    received = json.loads(done.stdout)
    # Slicer reads all arguments after this option as folders of modules.
    assert received["arguments"] == [
        "--no-splash",
        "scene.mrb",
        "--additional-module-paths",
        *MODULES,
    ]
    environment = received["environment"]
    assert environment[HOOK_DONE] == "1"
    libraries = environment["LD_LIBRARY_PATH"].split(os.pathsep)
    assert libraries[0] == str(Path(sys.prefix) / "lib")
    assert "/lib/of/mine" in libraries
    assert environment["PYTHONPATH"].split(os.pathsep) == [
        "/mine",
        str(ROOT),
        sysconfig.get_path("purelib"),
    ]
    assert done.stderr == ""


def test_environment_suffices_for_another_python_to_import_ros_and_marginguard():
    """``-S`` ignores .pth files, as an embedded Python does."""
    environment = slicer_environment({})
    code = "import rclpy, numpy, app.bridge, marginguard_msgs.msg; print(app.__file__)"
    done = subprocess.run(
        [sys.base_prefix + f"/bin/python{OURS}", "-S", "-c", code],
        capture_output=True,
        text=True,
        cwd="/",
        env=environment,
    )
    assert done.stdout.strip() == str(ROOT / "app" / "__init__.py"), done.stderr


def test_print_shows_a_command_that_a_shell_can_run(install, capsys):
    assert main(["slicer", "--slicer", str(install()), "--print"]) == 0
    shown = capsys.readouterr().out
    assert shlex.split(shown)[0] == "env"
    done = subprocess.run(shown, shell=True, capture_output=True, text=True)
    assert done.returncode == 7
    received = json.loads(done.stdout)
    assert received["arguments"] == ["--additional-module-paths", *MODULES]
    assert received["environment"][HOOK_DONE] == "1"


@pytest.mark.parametrize(
    ("version", "message"),
    [
        ("Python 3.9.10", "has Python 3.9; expected "),
        ("nonsense", "printed 'nonsense'; expected 'Python "),
    ],
)
def test_unsuitable_python_is_reported_in_one_line(install, capsys, version, message):
    assert main(["slicer", "--slicer", str(install(version)), "--print"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1


def test_python_beside_the_program_is_checked(install, capsys):
    program = install("Python 2.7.1", where=".")
    assert main(["slicer", "--slicer", str(program), "--print"]) == 2
    assert "has Python 2.7" in capsys.readouterr().err


def test_missing_python_is_reported_as_not_checked(install, capsys):
    assert main(["slicer", "--slicer", str(install(None)), "--print"]) == 0
    assert "could not check" in capsys.readouterr().err


def test_path_that_is_not_a_program_is_rejected(install, tmp_path, capsys):
    plain = tmp_path / "plain"
    plain.write_text("not a program")
    for path, message in (
        (tmp_path / "missing", "no such file"),
        (tmp_path, "is a folder"),
        (plain, "is not executable"),
    ):
        assert main(["slicer", "--slicer", str(path)]) == 2
        err = capsys.readouterr().err
        assert message in err
        assert str(path) in err
        assert err.count("\n") == 1


def test_installation_without_the_modules_is_reported(install, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("app.files.paths._SHARE", tmp_path)
    assert main(["slicer", "--slicer", str(install()), "--print"]) == 2
    assert f"{tmp_path / 'slicer_module' / 'MarginGuard'}: no such" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        ("echo 'GNU bash 5.2'", "printed 'GNU bash 5.2'; expected the program of 3D Slicer 5.x"),
        ("echo 'Slicer 4.11.20210226'", "is Slicer 4.11; expected the program of 3D Slicer 5.x"),
        ("exit 1", "printed ''; expected the program of 3D Slicer 5.x"),
    ],
)
def test_program_that_is_not_slicer_5_is_refused(install, capsys, script, problem):
    program = install()
    program.write_text(f"#!/bin/sh\n# TEST DOUBLE of another program\n{script}\n")
    assert main(["slicer", "--slicer", str(program), "--print"]) == 2
    error_text = capsys.readouterr().err
    assert problem in error_text
    assert error_text.count("\n") == 1


def test_program_that_does_not_answer_is_refused(install, capsys, monkeypatch):
    monkeypatch.setattr("app.cli.commands.slicer._VERSION_TIMEOUT_S", 0.1)
    program = install()
    program.write_text("#!/bin/sh\n# TEST DOUBLE of a program that waits\nexec sleep 60\n")
    assert main(["slicer", "--slicer", str(program), "--print"]) == 2
    assert "--version did not answer within 0.1 s" in capsys.readouterr().err
