"""Copy a case to a new folder with its recording as MCAP; keeps stamps, statuses and joints."""

import argparse

from app.cli.options import add_case, folder_path

SUMMARY = "copy a case, its recording converted to MCAP"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard convert``."""
    add_case(parser)
    parser.add_argument(
        "folder", type=folder_path, metavar="DIR", help="new folder for the MCAP case"
    )


def run(options: argparse.Namespace) -> int:
    """Convert the case and print the notes of the reader."""
    from app.case import convert_case, open_case

    case = open_case(options.case, package_dirs=options.package_dirs)
    convert_case(case, options.folder)
    for note in case.notes():
        print(f"note: {note}")
    print(f"wrote {options.folder}")
    return 0
