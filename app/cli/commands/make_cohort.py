"""Write the manifest of a simulated cohort: seeds and ranges of options, but no recordings.

'marginguard cohort' makes each case from it on a worker and keeps only the results. 'marginguard
make-case DIR --cohort MANIFEST --case NAME' writes the recording of one of its cases.
"""

import argparse

from app.cli.options import folder_path
from app.cli.simulated_case_options import TRACKERS

SUMMARY = "write the manifest of a simulated cohort"

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard make-cohort``."""
    parser.add_argument(
        "-n", "--count", type=_positive, required=True, metavar="N", help="number of cases"
    )
    parser.add_argument(
        "--seed",
        type=_integer,
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
        type=_positive,
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


def run(options: argparse.Namespace) -> int:
    """Write ``cohort.yaml``."""
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


def _integer(text: str) -> int:
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(f"{text!r}; expected an integer of 0 or more")
    return int(text)


def _positive(text: str) -> int:
    number = _integer(text)
    if not 1 <= number <= 10_000_000:
        raise argparse.ArgumentTypeError(f"{text!r}; expected 1 to 10000000")
    return number
