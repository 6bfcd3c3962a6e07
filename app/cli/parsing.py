"""Argument parser that reports a usage error in one line, with a suggestion for a misspelt word."""

import argparse
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from app.cli.errors import BAD_INPUT
from app.files.keys import did_you_mean


class UsageError(SystemExit):
    """The command line is invalid; `main` prints ``message`` and the exit status is 2."""

    def __init__(self, message: str) -> None:
        super().__init__(BAD_INPUT)
        self.message = message


class CommandParser(argparse.ArgumentParser):
    """`argparse.ArgumentParser` that raises `UsageError` and suggests similar words."""

    _received: Sequence[str] = ()

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Parse as argparse does; each parser refuses its own unknown arguments."""
        self._received = () if args is None else tuple(args)
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError` with ``message`` and the suggestions for misspelt options."""
        raise UsageError(f"{self.prog}: error: {message}{''.join(self._suggestions())}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
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
