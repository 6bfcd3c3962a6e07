"""Copy the intact messages of a recording to a new MCAP file with an index, as after a crash."""

import argparse
from pathlib import Path

from app.cli.options import input_argument

SUMMARY = "copy a recording that was cut to an MCAP file with an index"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard recover``."""
    parser.add_argument(
        "recording",
        type=input_argument,
        metavar="RECORDING",
        help=".mcap file or rosbag2 folder; it is not changed",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="new .mcap file")


def run(options: argparse.Namespace) -> int:
    """Copy the messages, and print notes and the number of messages by topic."""
    from app.case import recover_recording
    from app.files import check_output_path
    from app.geometry import InputError

    if options.file.suffix.lower() != ".mcap":
        raise InputError(f"{options.file}: unknown ending; expected .mcap")
    check_output_path(options.file)
    counts, notes = recover_recording(options.recording, options.file)
    for note in notes:
        print(f"note: {note}")
    print(f"wrote {options.file}: {sum(counts.values())} messages of {len(counts)} topics")
    for topic, count in counts.items():
        print(f"  {topic}: {count}")
    return 0
