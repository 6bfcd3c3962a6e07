"""Argument parser that reports a usage error in one line, and errors on standard error."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

from app.files.keys import did_you_mean

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


class UsageError(SystemExit):
    """The command line is invalid; `main` prints ``message`` and the exit status is 2."""

    def __init__(self, message: str) -> None:
        super().__init__(BAD_INPUT)
        self.message = message


def add_debug(parser: argparse.ArgumentParser) -> None:
    """Add the option that every command has; where it is not given, it keeps its value."""
    parser.add_argument(
        "--debug",
        action="store_true",
        default=argparse.SUPPRESS,
        help="show the traceback of an error",
    )


class CommandParser(argparse.ArgumentParser):
    """`argparse.ArgumentParser` that raises `UsageError` and suggests similar words."""

    moved: Mapping[str, str] = {}
    """Commands of earlier versions, with a sentence about what replaces each."""
    subcommands: "argparse._SubParsersAction[CommandParser] | None" = None
    _received: Sequence[str] = ()

    def add_subcommand(
        self, name: str, run: Callable[[argparse.Namespace], int], summary: str
    ) -> "CommandParser":
        """Add a sub-command, which stands first, in place of the arguments of this parser.

        Its description is the docstring of ``run``.
        """
        if self.subcommands is None:
            self.subcommands = self.add_subparsers(
                title="sub-commands",
                description=f"in place of the arguments above; see '{self.prog} SUBCOMMAND --help'",
                metavar="SUBCOMMAND",
                prog=self.prog,
            )
            self._remove_action(self.subcommands)  # else a positional argument of every call
        parser = self.subcommands.add_parser(name, help=summary, description=run.__doc__)
        add_debug(parser)
        parser.set_defaults(run=run)
        return parser

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parse as argparse does; each parser refuses its own unknown arguments."""
        self._received = () if args is None else tuple(args)
        if self.subcommands is not None and args and args[0] in self.subcommands.choices:
            return self.subcommands.choices[args[0]].parse_known_args(args[1:], namespace)
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError` with ``message`` and the suggestions for misspelt options."""
        raise UsageError(f"{self.prog}: error: {message}{''.join(self._suggestions())}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            if value in self.moved:
                raise UsageError(f"{self.prog}: error: {value}: {self.moved[value]}")
            choices = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(
                action,
                f"invalid choice: {value!r}{did_you_mean(value, choices)}; "
                f"expected one of {', '.join(choices)}",
            )

    def _suggestions(self) -> Iterable[str]:
        known = list(self._option_string_actions)
        for argument in self._received:
            if argument == "--":
                return
            name = argument.partition("=")[0]
            if name.startswith("--") and not any(each.startswith(name) for each in known):
                suggestion = did_you_mean(name, known)
                if suggestion:
                    yield f"; {name}: unknown option{suggestion}"
