"""Entry point of ``marginguard``: parse arguments, run a command, print errors in one line.

Exit status: 0; 1 when a check did not hold; 2 on bad input; 130 when interrupted, 143 when
terminated, 141 when the reader of standard output has closed it, as shells report it.
"""

import argparse
import atexit
import gc
import sys
import traceback
from collections.abc import Sequence
from types import ModuleType

from app import __version__
from app.cli.commands import (
    bench,
    calibrate,
    clean,
    convert,
    doctor,
    igtl,
    info,
    live,
    make_case,
    rearm,
    record,
    register,
    replay,
    schema,
    serve,
    slicer,
    tracker,
    tumor,
    view,
)
from app.cli.signals import Terminated, raise_signals

COMMANDS: dict[str, ModuleType] = {
    "replay": replay,
    "serve": serve,
    "view": view,
    "live": live,
    "rearm": rearm,
    "tracker": tracker,
    "record": record,
    "register": register,
    "calibrate": calibrate,
    "info": info,
    "convert": convert,
    "tumor": tumor,
    "make-case": make_case,
    "schema": schema,
    "igtl": igtl,
    "slicer": slicer,
    "bench": bench,
    "doctor": doctor,
    "clean": clean,
}
BAD_INPUT = 2
INTERRUPTED, TERMINATED = 130, 143
NO_READER = 141

MAX_LINE_CHARS = 500
"""Longest error line; the middle of a longer one is left out."""


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="marginguard",
        description="Margin guard for image-guided robotic intervention. "
        "A research tool, not a medical device.",
        epilog="'marginguard COMMAND --help' lists the options of a command.",
    )
    parser.add_argument("--version", action="version", version=f"marginguard {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, module in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=module.SUMMARY, description=module.__doc__)
        module.add_arguments(subparser)
        subparser.add_argument(
            "--debug", action="store_true", help="show the traceback of an error"
        )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    # Skip the garbage collection at exit, which takes half a second.
    atexit.register(gc.freeze)
    options = build_parser().parse_args(arguments)
    try:
        with raise_signals():
            status: int = COMMANDS[options.command].run(options)
        if sys.stdout is not None:  # None if the caller has closed it
            sys.stdout.flush()
    except KeyboardInterrupt as end:
        return TERMINATED if isinstance(end, Terminated) else INTERRUPTED
    except BrokenPipeError:
        # Nothing more can be printed, but the caller must not take this for success.
        sys.stderr.close()
        return NO_READER
    except Exception as error:
        if options.debug:
            traceback.print_exc()
        print(f"marginguard: error: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT
    return status


def _one_line(error: Exception) -> str:
    from app.files.extras import extra_with, install_hint
    from app.geometry import MarginGuardError

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
