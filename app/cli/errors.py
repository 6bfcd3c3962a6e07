"""Errors of commands on standard error: one line of text, or one line of JSON with ``--json``."""

import json
import sys
from collections.abc import Sequence

BAD_INPUT = 2


def wants_json(arguments: Sequence[str]) -> bool:
    """True if ``--json`` is given; behind the command ``bench`` it is an option of the benchmark.

    For usage errors only: the parsed options also know abbreviations.
    """
    before_end = list(arguments)
    if "--" in before_end:
        before_end = before_end[: before_end.index("--")]
    command = next((word for word in before_end if not word.startswith("-")), None)
    if command == "bench":
        before_end = before_end[: before_end.index(command)]
    return "--json" in before_end


def print_error(message: str, kind: str, *, as_json: bool) -> None:
    """Print an error that ends the command with exit status 2.

    ``kind`` is ``usage`` (of the command line), ``input`` (a file, a value, the machine) or
    ``unexpected`` (an error of the program).
    """
    if as_json:
        error = {"message": message, "kind": kind, "exit_status": BAD_INPUT}
        message = json.dumps({"error": error}, allow_nan=False)
    print(message, file=sys.stderr)
