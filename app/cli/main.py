"""Entry point of ``marginguard``: parse arguments, run a command, print errors in one line.

Exit status: 0; 1 when a check did not hold; 2 on bad input; 130 when interrupted, 143 when
terminated, 141 when the reader of standard output has closed it, as shells report it.
"""

import os
import sys
import traceback
from collections.abc import Sequence
from types import ModuleType

from app import __version__
from app.cli.commands import (
    analyse,
    bench,
    calibrate,
    cohort,
    control,
    convert,
    doctor,
    info,
    init,
    live,
    make_case,
    plan,
    rearm,
    record,
    replay,
    serve,
    simulate,
    slicer,
    tracker,
    tumor,
    view,
)
from app.cli.parsing import BAD_INPUT, CommandParser, UsageError, add_debug, print_error, wants_json
from app.cli.process import Terminated, raise_signals
from app.files.extras import extra_with, install_hint
from app.geometry import MarginGuardError

COMMANDS: dict[str, ModuleType] = {
    "replay": replay,
    "analyse": analyse,
    "serve": serve,
    "view": view,
    "live": live,
    "rearm": rearm,
    "tracker": tracker,
    "record": record,
    "calibrate": calibrate,
    "plan": plan,
    "init": init,
    "info": info,
    "convert": convert,
    "tumor": tumor,
    "make-case": make_case,
    "cohort": cohort,
    "simulate": simulate,
    "control": control,
    "slicer": slicer,
    "bench": bench,
    "doctor": doctor,
}
MOVED = {
    "register": "calibrate robot-base CASE",
    "recover": "convert recover RECORDING FILE",
    "export-dicom": "convert dicom CASE --out DIR",
    "library": "view FOLDER",
    "make-cohort": "make-case cohort -n N --out DIR",
    "operation": "simulate operation DIR",
    "igtl": "tracker igtl --host HOST --port PORT",
    "schema": "doctor schema DOCUMENT",
    "completion": "doctor completion SHELL",
    "clean": "doctor clean",
    "images": "info images SEQUENCE",
}
"""Commands of earlier versions, with what replaces each."""

INTERRUPTED, TERMINATED = 130, 143
NO_READER = 141

MAX_LINE_CHARS = 500
"""Longest error line; the middle of a longer one is left out."""


def build_parser(given: Sequence[str] = ()) -> CommandParser:
    """The parser of the whole command line, or of the command alone that ``given`` begins with.

    To declare the options of all of them takes 15 ms.
    """
    command = next((word for word in given if not word.startswith("-")), "")
    parser = CommandParser(
        prog="marginguard",
        description="Margin guard for image-guided robotic intervention. "
        "A research tool, not a medical device.",
        epilog="'marginguard COMMAND --help' lists the options of a command, and its sub-commands.",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        dest="all_json",
        help="print errors as JSON, and the output of commands that have --json",
    )
    parser.add_argument("--version", action="version", version=f"marginguard {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=module.SUMMARY, description=module.__doc__)
        if name == command or command not in COMMANDS:
            module.add_arguments(subparser)
        add_debug(subparser)
        subparser.set_defaults(run=module.run)
    parser.moved = {
        old: f"is part of {new.split()[0]}; expected marginguard {new}"
        for old, new in MOVED.items()
    }
    parser.set_defaults(debug=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        options = build_parser(given).parse_args(given)
    except UsageError as error:
        print_error(error.message, "usage", as_json=wants_json(given))
        raise
    as_json = options.json = getattr(options, "json", False) or options.all_json
    try:
        with raise_signals():
            status: int = options.run(options)
        if sys.stdout is not None:  # None if the caller has closed it
            sys.stdout.flush()
    except KeyboardInterrupt as end:
        return TERMINATED if isinstance(end, Terminated) else INTERRUPTED
    except BrokenPipeError:
        # Nothing more can be printed, but the caller must not take this for success. What is
        # buffered goes nowhere, so that the interpreter does not fail to write it as it ends.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        return NO_READER
    except Exception as error:
        if options.debug:
            traceback.print_exc()
        expected = isinstance(error, MarginGuardError | OSError)
        text = _one_line(error)
        print_error(
            text if as_json else f"marginguard: error: {text}",
            "input" if expected else "unexpected",
            as_json=as_json,
        )
        return BAD_INPUT
    return status


def _one_line(error: Exception) -> str:
    text = str(error)
    if isinstance(error, ModuleNotFoundError) and extra_with(error.name or ""):
        return f"{text}: {install_hint(error)}"
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    text = " ".join(text.split())
    if len(text) > MAX_LINE_CHARS:
        text = f"{text[: MAX_LINE_CHARS // 2]} ... {text[-MAX_LINE_CHARS // 2 :]}"
    if isinstance(error, MarginGuardError | OSError) and text:
        return text
    return f"unexpected {type(error).__name__}: {text} (--debug shows where)"
