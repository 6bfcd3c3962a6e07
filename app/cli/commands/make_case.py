"""Write a simulated lumpectomy with its ground truth; the same seed gives the same bytes."""

import argparse
from pathlib import Path

from app.cli.options import folder_path
from app.cli.progress import progress_with_total
from app.cli.simulated_case_options import add_simulated_case, simulated_case_options

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


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"invalid seed {text!r}; expected an integer of 0 or more")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Simulate a case with the Touch arm."""
    from app.geometry import InputError
    from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME, simulate_case
    from app.synthetic.touch_arm import TouchArm

    if options.folder.is_dir() and options.folder.samefile(Path.cwd()):
        # An empty folder is replaced at the end: a shell in it would stay in the deleted one.
        raise InputError(f"{options.folder} is the current folder; expected another one")
    case_options = simulated_case_options(options)
    arm = TouchArm(base_frame=BASE_FRAME, tip_frame=CAUTERY_TIP_FRAME)
    with progress_with_total("simulating frame") as report:
        simulate_case(
            options.folder, seed=options.seed, arm=arm, options=case_options, on_frame=report
        )
    print(f"wrote {options.folder}")
    return 0
