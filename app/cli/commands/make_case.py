"""Write a simulated lumpectomy with its ground truth; the same seed gives the same bytes."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import folder_path, input_argument
from app.cli.progress import progress_with_total
from app.cli.simulated_case_options import (
    add_simulated_case,
    simulated_case_arguments,
    simulated_case_options,
)

if TYPE_CHECKING:
    from app.synthetic import CaseOptions

SUMMARY = "write a simulated case with ground truth"
DEFAULT_SEED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard make-case``."""
    parser.add_argument("folder", type=folder_path, metavar="DIR", help="new folder for the case")
    parser.add_argument(
        "--seed",
        type=_seed,
        default=DEFAULT_SEED,
        metavar="N",
        help="seed of all random values, 0 or more (%(default)s)",
    )
    add_simulated_case(parser)
    of_cohort = parser.add_argument_group("case of a cohort", "Instead of the options above.")
    of_cohort.add_argument(
        "--cohort", type=input_argument, metavar="MANIFEST", help="cohort.yaml of 'make-cohort'"
    )
    of_cohort.add_argument("--case", metavar="NAME", help="name of one of its cases")


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"invalid seed {text!r}; expected an integer of 0 or more")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Simulate a case with the Touch arm."""
    from app.geometry import InputError
    from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME, simulate_case
    from app.synthetic.motion import TouchArm

    if options.folder.is_dir() and options.folder.samefile(Path.cwd()):
        # An empty folder is replaced at the end: a shell in it would stay in the deleted one.
        raise InputError(f"{options.folder} is the current folder; expected another one")
    seed, case_options = options.seed, simulated_case_options(options)
    if options.cohort is not None or options.case is not None:
        seed, case_options = _of_cohort(options)
    arm = TouchArm(base_frame=BASE_FRAME, tip_frame=CAUTERY_TIP_FRAME)
    arguments = ["--seed", str(seed), *simulated_case_arguments(options)]
    if options.cohort is not None:
        arguments = ["--cohort", options.cohort.name, "--case", options.case]
    with progress_with_total("simulating frame") as report:
        simulate_case(
            options.folder,
            seed=seed,
            arm=arm,
            options=case_options,
            command=" ".join(["marginguard make-case DIR", *arguments]),
            on_frame=report,
        )
    print(f"wrote {options.folder}")
    return 0


def _of_cohort(options: argparse.Namespace) -> "tuple[int, CaseOptions]":
    """Seed and options of a case of a manifest."""
    from app.cohort import open_manifest
    from app.geometry import InputError
    from app.synthetic import CaseOptions

    if options.cohort is None or options.case is None:
        raise InputError("one of --cohort and --case is missing; expected both")
    if options.seed != DEFAULT_SEED or simulated_case_options(options) != CaseOptions():
        raise InputError("--cohort: with other options of the case; expected --case alone")
    case = open_manifest(options.cohort).case(options.case)
    if case.synthetic is None:
        raise InputError(f"case {case.name!r} is recorded: {case.source}; expected a simulated one")
    return case.synthetic.seed, case.synthetic.options()
