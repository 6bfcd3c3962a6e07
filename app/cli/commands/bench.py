"""Run a benchmark of this installation and of peers in one run, and compare the figures.

Exit status: that of the benchmark; 1 when a figure misses its goal.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from app.files.shipped import shipped

SUMMARY = "run a benchmark and compare its figures with those of peers"
BENCHMARKS = {
    "registration": "benchmarks.registration",
    "fixture": "benchmarks.fixture",
    "fixture-agreement": "benchmarks.fixture_agreement",
    "push": "benchmarks.fixture_push",
    "session": "benchmarks.session",
    "frozen": "benchmarks.frozen",
    "plausibility": "benchmarks.plausibility",
    "rate": "benchmarks.rate",
    "latency": "benchmarks.latency",
    "faults": "benchmarks.faults",
    "soak": "benchmarks.soak",
    "kinematics": "benchmarks.kinematics",
    "replay": "benchmarks.replay",
    "report": "benchmarks.complete_report",
    "view": "benchmarks.view",
    "images": "benchmarks.images",
    "fuzz": "benchmarks.fuzz",
    "record": "benchmarks.recorder",
    "simulation": "benchmarks.simulation",
    "guided": "benchmarks.guided",
    "depth": "benchmarks.depth",
    "probability": "benchmarks.probability",
    "passivity": "benchmarks.passivity",
    "closed-loop": "benchmarks.closed_loop",
    "cohort": "benchmarks.cohort",
    "edits": "benchmarks.edits",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard bench``; options after the name are the benchmark's."""
    parser.add_argument(
        "name", choices=tuple(BENCHMARKS), help="the benchmark: docs/benchmarks.md describes each"
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
    from app.files import check_output_path
    from app.geometry import InputError

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
        [sys.executable, "-m", "app.cli.benchmark", BENCHMARKS[options.name], *options.options],
        env={**os.environ, "PYTHONPATH": code, "PYTHONSAFEPATH": "1"},
        check=False,
    ).returncode


def _output_paths(options: Sequence[str]) -> list[Path]:
    """The files that the benchmark writes, to check them before it runs for minutes."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    for name in ("--json", "--plot"):
        parser.add_argument(name, type=Path, nargs="?")
    return [path for path in vars(parser.parse_known_args(options)[0]).values() if path]
