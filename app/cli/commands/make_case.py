"""Write a simulated lumpectomy with its ground truth; the same seed gives the same bytes."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import folder_path, input_argument, integer
from app.cli.parsing import CommandParser
from app.cli.progress import progress_with_total
from app.cli.simulated_case_options import (
    TRACKERS,
    add_simulated_case,
    simulated_case_arguments,
    simulated_case_options,
)
from app.geometry import InputError

if TYPE_CHECKING:
    from app.synthetic import CaseOptions


SUMMARY = "write a simulated case with ground truth, or the manifest of many"
DEFAULT_SEED = 1
_COUNT = integer(1, 10_000_000)


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard make-case``."""
    parser.add_argument("folder", type=folder_path, metavar="DIR", help="new folder for the case")
    parser.add_argument(
        "--seed",
        type=_seed,
        default=DEFAULT_SEED,
        metavar="N",
        help="seed of all random values, 0 or more (%(default)s)",
    )
    parser.add_argument(
        "--structures",
        action="store_true",
        help="with a second lesion and a chest wall, in schema 2",
    )
    add_simulated_case(parser)
    of_cohort = parser.add_argument_group("case of a cohort", "Instead of the options above.")
    of_cohort.add_argument(
        "--cohort",
        type=input_argument,
        metavar="MANIFEST",
        help="cohort.yaml of 'make-case cohort'",
    )
    of_cohort.add_argument("--case", metavar="NAME", help="name of one of its cases")
    _add_cohort_arguments(
        parser.add_subcommand("cohort", _run_cohort, "write the manifest of a simulated cohort")
    )


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"invalid seed {text!r}; expected an integer of 0 or more")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Simulate a case with the Touch arm."""
    from app.synthetic import simulate_case
    from app.synthetic.motion import TouchArm

    if options.folder.is_dir() and options.folder.samefile(Path.cwd()):
        # An empty folder is replaced at the end: a shell in it would stay in the deleted one.
        raise InputError(f"{options.folder} is the current folder; expected another one")
    seed, case_options = options.seed, simulated_case_options(options)
    if options.cohort is not None or options.case is not None:
        seed, case_options = _of_cohort(options)
    arguments = ["--seed", str(seed), *simulated_case_arguments(options)]
    if options.structures:
        arguments.append("--structures")
    if options.cohort is not None:
        arguments = ["--cohort", options.cohort.name, "--case", options.case]
    with progress_with_total("simulating frame") as report:
        simulate_case(
            options.folder,
            seed=seed,
            arm=TouchArm(),
            options=case_options,
            command=" ".join(["marginguard make-case DIR", *arguments]),
            structures=options.structures,
            on_frame=report,
        )
    print(f"wrote {options.folder}")
    return 0


def _of_cohort(options: argparse.Namespace) -> "tuple[int, CaseOptions]":
    """Seed and options of a case of a manifest."""
    from app.cohort import open_manifest
    from app.synthetic import CaseOptions

    if options.cohort is None or options.case is None:
        raise InputError("one of --cohort and --case is missing; expected both")
    if options.seed != DEFAULT_SEED or simulated_case_options(options) != CaseOptions():
        raise InputError("--cohort: with other options of the case; expected --case alone")
    case = open_manifest(options.cohort).case(options.case)
    if case.synthetic is None:
        raise InputError(f"case {case.name!r} is recorded: {case.source}; expected a simulated one")
    return case.synthetic.seed, case.synthetic.options()


DEFAULT_RANGES = {
    "tumor_mm": (22.0, 36.0),
    "elongation": (1.0, 1.6),
    "irregularity": (0.5, 1.25),
    "tumor_x_mm": (-8.0, 8.0),
    "tumor_y_mm": (-8.0, 8.0),
    "tumor_z_mm": (-8.0, 8.0),
    "breath_mm": (2.0, 8.0),
    "breath_hz": (0.18, 0.33),
    "skill": (0.0, 1.0),
}
"""Assumed spread of patients and surgeons; every key of the manifest can be edited."""


def _add_cohort_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard make-case cohort``."""
    parser.add_argument(
        "-n", "--count", type=_COUNT, required=True, metavar="N", help="number of cases"
    )
    parser.add_argument(
        "--seed",
        type=integer(0, expected="an integer of 0 or more"),
        default=1,
        metavar="S",
        help="seed of all random values, 0 or more (%(default)s)",
    )
    parser.add_argument(
        "--out", type=folder_path, required=True, metavar="DIR", help="new folder for cohort.yaml"
    )
    parser.add_argument(
        "--tracker",
        choices=TRACKERS,
        action="append",
        dest="trackers",
        help="preset that a case may have; may be repeated (default: white)",
    )
    parser.add_argument(
        "--surgeons",
        type=_COUNT,
        default=8,
        metavar="K",
        help="number of surgeons, each with a skill (%(default)s)",
    )
    parser.add_argument(
        "--fixture",
        choices=("paired", "alternate", "off", "on"),
        default="paired",
        help="virtual fixture: paired makes two cases of every draw, without and with it; "
        "alternate gives it to every second case (%(default)s)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="length of every case, 50 to 5400 s (default: 75 to 95 s, by skill)",
    )


def _run_cohort(options: argparse.Namespace) -> int:
    """Write the manifest of a simulated cohort: seeds and ranges of options, but no recordings.

    'marginguard cohort' makes each case from it on a worker and keeps only the results.
    'marginguard make-case DIR --cohort MANIFEST --case NAME' writes the recording of one of its
    cases.
    """
    from app.cohort import MANIFEST_FILE, Design, write_manifest

    ranges = dict(DEFAULT_RANGES)
    if options.duration is not None:
        ranges["duration_s"] = (options.duration, options.duration)
    design = Design(
        options.count,
        options.seed,
        tuple(dict.fromkeys(options.trackers or TRACKERS[:1])),
        options.surgeons,
        options.fixture,
        ranges,
    )
    write_manifest(options.out, f"simulated cohort {options.seed}", design)
    print(f"wrote {options.out / MANIFEST_FILE}")
    return 0
