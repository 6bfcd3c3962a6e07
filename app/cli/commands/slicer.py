"""Start desktop 3D Slicer with MarginGuard's modules and the environment that ROS needs there.

Slicer's Python must be of the same minor version as this one, whose compiled packages it loads.
The program must be 3D Slicer 5.x: it is started with --version first. With --print the command is
shown, and Slicer is not started. Exit status: Slicer's; 2 on bad input.
"""

import argparse
import os
import re
import shlex
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path

from app.files.child_process import ChildError, run_to_end
from app.files.paths import checkout, shipped
from app.geometry import InputError

SUMMARY = "start desktop 3D Slicer with MarginGuard's modules"
MODULES = ("MarginGuard", "ROS2")
HOOK_DONE = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
"""When set, the start-up hook of the ROS wheels does not replace Slicer by a Python interpreter."""

_VERSION_TIMEOUT_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard slicer``."""
    parser.add_argument(
        "--slicer", type=Path, required=True, metavar="PATH", help="Slicer's own program"
    )
    parser.add_argument(
        "--print", action="store_true", dest="only_print", help="show the command, start nothing"
    )
    parser.add_argument(
        "arguments", nargs="*", metavar="ARGUMENT", help="after '--': passed to Slicer"
    )


def run(options: argparse.Namespace) -> int:
    """Replace this process by Slicer, which then receives signals and sets the exit status."""
    program = _checked_program(options.slicer)
    _check_version(program)
    _check_python(program)
    # Last, because Slicer takes all following arguments for modules, even a scene file.
    command = [str(program), *options.arguments, "--additional-module-paths", *_module_folders()]
    added = slicer_environment(os.environ)
    if not options.only_print:
        sys.stderr.flush()
        os.execve(program, command, {**os.environ, **added})
    print(shlex.join(["env", *(f"{name}={value}" for name, value in added.items()), *command]))
    return 0


def slicer_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables that Slicer needs beside ``environment``: our packages, ROS libraries, no hook.

    Our folders come after the existing ones: Slicer's launcher puts its own folders first, and
    Slicer has to import its own ``slicer``, ``vtk`` and ``numpy``, not ours.
    """
    packages = sysconfig.get_path("purelib")
    libraries = (
        str(Path(sys.prefix) / "lib"),
        *(str(folder) for folder in sorted(Path(packages).glob("ros_*.libs"))),
    )
    return {
        HOOK_DONE: "1",
        "LD_LIBRARY_PATH": _joined(*libraries, environment.get("LD_LIBRARY_PATH", "")),
        "PYTHONPATH": _joined(environment.get("PYTHONPATH", ""), str(checkout() or ""), packages),
    }


def _joined(*paths: str) -> str:
    """Join the folders, each once, in the order of their first occurrence."""
    folders = (folder for path in paths for folder in path.split(os.pathsep) if folder)
    return os.pathsep.join(dict.fromkeys(folders))


def _checked_program(path: Path) -> Path:
    if not path.exists():
        raise InputError(f"--slicer {path}: no such file; expected the program Slicer")
    if path.is_dir():
        raise InputError(f"--slicer {path} is a folder; expected the program Slicer in it")
    if not os.access(path, os.X_OK):
        raise InputError(f"--slicer {path} is not executable; expected the program Slicer")
    return path.resolve()


def _module_folders() -> list[str]:
    folders = [shipped("slicer_module", name) for name in MODULES]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(
                f"{folder}: no such folder; expected a module that MarginGuard ships: "
                "install it again"
            )
    return [str(folder) for folder in folders]


def _check_version(program: Path) -> None:
    """Raise `InputError` if ``program --version`` does not print the version of 3D Slicer 5."""
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    environment["QT_QPA_PLATFORM"] = "offscreen"
    expected = "expected the program of 3D Slicer 5.x, which prints 'Slicer 5.x'"
    output = _printed(program, "--version", expected, environment)
    found = re.search(r"\bSlicer (\d+)\.\d+", output)
    if found is None:
        raise InputError(f"{program} --version printed {output[:80]!r}; {expected}")
    if found[1] != "5":
        raise InputError(f"{program} is {found[0]}; {expected}")


def _check_python(program: Path) -> None:
    """Raise `InputError` if Slicer's Python cannot load our packages; note if it is not found."""
    ours = f"{sys.version_info.major}.{sys.version_info.minor}"
    candidates = (program.parent / "bin" / "PythonSlicer", program.parent / "PythonSlicer")
    python = next((path for path in candidates if os.access(path, os.X_OK)), None)
    if python is None:
        print(
            f"no PythonSlicer beside {program}: could not check that it has Python {ours}",
            file=sys.stderr,
        )
        return
    expected = f"expected 'Python {ours}'"
    output = _printed(python, "-V", expected)
    found = re.search(r"\bPython (\d+\.\d+)\b", output)
    if found is None:
        raise InputError(f"{python} -V printed {output[:80]!r}; {expected}")
    if found[1] != ours:
        raise InputError(
            f"{program} has Python {found[1]}; expected {ours}, which these packages are for: "
            f"create an environment with Python {found[1]} (3.11 to 3.13), or use a Slicer with "
            f"Python {ours}"
        )


def _printed(
    program: Path, option: str, expected: str, environment: Mapping[str, str] | None = None
) -> str:
    """The output of ``program option``, in one line; raises `InputError` without an answer."""
    try:
        done = run_to_end([str(program), option], _VERSION_TIMEOUT_S, environment=environment)
    except ChildError as error:
        raise InputError(f"{program} {option} {error}; {expected}") from error
    return " ".join((done.stdout + done.stderr).decode(errors="replace").split())
