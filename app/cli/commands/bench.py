"""Run a benchmark of this installation and of peers in one run, and compare the figures.

Exit status: that of the benchmark; 1 when a figure misses its goal.
"""

import argparse
import os
import runpy
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from app.cli.parsing import BAD_INPUT, CommandParser
from app.files import check_output_path
from app.files.extras import extra_with, install_command, install_hint
from app.files.paths import shipped
from app.geometry import InputError

SUMMARY = "run a benchmark and compare its figures with those of peers"
BENCHMARKS = {
    "fixture": "time of one evaluation; FCL, coal and VTK",
    "session": "a session's step beside FCL's distance, and memory",
    "structures": "the same with 2, 20 and 100 structures; FCL's broad phase",
    "rate": "the constraint at 1 kHz to another process",
    "latency": "from a stamp in another process to the scene; timers and OpenIGTLink",
    "view": "pictures of the page a second, and delay from a pose to its pixels",
    "images": "live ultrasound: delay from an image's stamp to the page, and memory",
    "replay": "a whole replay, phase by phase; with --report all of its results",
    "simulation": "a physics step of a world; MuJoCo's own step",
    "closed-loop": "a hand pushes a simulated arm in real time, and processes that fail",
    "cohort": "a cohort with more workers: wall clock, memory, equal bytes",
    "soak": "a live session and its recorder for an hour: memory and gaps",
    "faults": "faults of tracker, robot, graph and process, judged from outside",
}
"""Help by name; the module is that of the name in the folder ``benchmarks``."""
MOVED = {
    "report": "marginguard bench replay --report",
    "push": "marginguard bench closed-loop",
    "guided": "marginguard bench closed-loop",
    "registration": "pytest tests/registration/test_long_accuracy.py",
    "fixture-agreement": "pytest tests/fixture/proximity/test_long_agreement.py",
    "frozen": "pytest tests/session/test_long_repetition.py",
    "plausibility": "pytest tests/session/plausibility/test_long_false_holds.py",
    "kinematics": "pytest tests/robot/test_long_kinematics.py",
    "fuzz": "pytest tests/fuzz/test_long_fuzzing.py",
    "record": "pytest tests/recorder/test_twenty_kills.py",
    "depth": "pytest tests/analysis/test_long_depth.py",
    "probability": "pytest tests/analysis/test_long_breach_probability.py",
    "passivity": "pytest tests/simulation/test_long_passivity.py",
    "edits": "pytest tests/bridge/simulation/test_body_edits.py",
}
"""Benchmarks of earlier versions, with the command that replaces each; tests run in a clone."""


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard bench``; options after the name are the benchmark's."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    lines = "".join(f"\n  {name:12}  {text}" for name, text in BENCHMARKS.items())
    parser.epilog = f"benchmarks:{lines}"
    parser.moved = {old: f"is no longer a benchmark; expected {new}" for old, new in MOVED.items()}
    parser.add_argument(
        "name", choices=tuple(BENCHMARKS), metavar="NAME", help="a benchmark of the list below"
    )
    parser.add_argument(
        "options",
        nargs=argparse.REMAINDER,
        help="options of the benchmark; --help after its name lists them",
    )


def run(options: argparse.Namespace) -> int:
    """Run the benchmark in its own process, so that nothing loaded here disturbs its figures.

    It runs in the current folder, so that relative paths among its options stay valid, and imports
    its code from the shipped folder only.
    """
    root = shipped()
    if not (root / "benchmarks").is_dir():
        raise InputError(
            f"{root / 'benchmarks'}: no such folder; expected the benchmarks that MarginGuard "
            "ships: install it again"
        )
    for path in _output_paths(options.options):
        check_output_path(path)
    code = os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
    return subprocess.run(
        [sys.executable, "-m", "app.cli.commands.bench", _module(options.name), *options.options],
        env={**os.environ, "PYTHONPATH": code, "PYTHONSAFEPATH": "1"},
        check=False,
    ).returncode


def _module(name: str) -> str:
    return f"benchmarks.{name.replace('-', '_')}"


def _output_paths(options: Sequence[str]) -> list[Path]:
    """The files that the benchmark writes, to check them before it runs for minutes."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    for name in ("--json", "--plot"):
        parser.add_argument(name, type=Path, nargs="?")
    return [path for path in vars(parser.parse_known_args(options)[0]).values() if path]


def main() -> None:
    """Run ``main`` of the module that the first argument names.

    A peer that is missing is one line of error; peers come with the extra ``test``.
    """
    module = sys.argv.pop(1)
    try:
        sys.exit(runpy.run_module(module)["main"]())
    except ModuleNotFoundError as error:
        missing = f"this benchmark needs {error.name}, which is not installed"
        if extra_with(error.name or ""):
            remedy = install_hint(error)
        else:
            remedy = f"run `{install_command('test')}`, which installs what benchmarks need"
        print(f"marginguard: error: {missing}: {remedy}", file=sys.stderr)
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
