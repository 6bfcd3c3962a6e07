"""Parser of a benchmark's options, which checks the range of each number."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.cli.options import input_argument

RECORDED_CASE = Path(__file__).resolve().parents[2] / "data/recorded_case"


class _Gone(argparse.Action):
    def __call__(self, *_: Any) -> None:
        raise argparse.ArgumentError(self, f"is gone; expected {self.const}")


class BenchParser(argparse.ArgumentParser):
    """Parser of ``marginguard bench NAME``, with ``--json FILE``."""

    def __init__(self, name: str, description: str | None) -> None:
        super().__init__(
            prog=f"marginguard bench {name}",
            description=description,
            epilog="Exit status 1 when a goal is missed.",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")

    def number(
        self,
        flag: str,
        default: float | Sequence[float] | None,
        text: str,
        *,
        low: float = 1,
        high: float = math.inf,
        above: bool = False,
        **settings: Any,
    ) -> None:
        """Add a number from ``low`` to ``high``, or ``above`` the low one; int if the default is.

        Several numbers by default: one or more, the range is that of each.
        """
        numbers = default if isinstance(default, Sequence) else (default,)
        if numbers is default:
            settings["nargs"] = "+"
        if default is not None:
            text = f"{text} (default: {' '.join(f'{each:g}' for each in numbers)})"
        kind = int if isinstance(numbers[0], int) else float

        def checked(word: str) -> float:
            value = kind(word)
            enough = low < value if above else low <= value
            if not (enough and value <= high and value < math.inf):
                lowest = f"more than {low:g}" if above else f"{low:g}"
                limit = f", at most {high:g}" if above else f" to {high:g}"
                if high == math.inf:
                    limit = "" if above else " or more"
                raise argparse.ArgumentTypeError(f"{word}; expected {lowest}{limit}")
            return value

        checked.__name__ = kind.__name__  # named in the message for a word that is no number
        self.add_argument(flag, type=checked, default=default, help=text, **settings)

    def gone(self, *flags: str, expected: str) -> None:
        """Refuse ``flags`` of an earlier version and name what is ``expected`` in their place."""
        self.add_argument(*flags, action=_Gone, nargs="?", const=expected, help=argparse.SUPPRESS)

    def case(self, flag: str = "--case") -> None:
        """Add the case to run on: an option, or an argument that may be missing."""
        optional = {} if flag.startswith("-") else {"nargs": "?"}
        text = "default: data/recorded_case"
        self.add_argument(flag, type=case_folder, default=RECORDED_CASE, help=text, **optional)


def case_folder(text: str) -> Path:
    """Case folder of an option; raises `argparse.ArgumentTypeError` without a case.yaml."""
    folder = input_argument(text)
    if not (folder / "case.yaml").is_file():
        raise argparse.ArgumentTypeError(f"{text!r} is no case; expected a folder with a case.yaml")
    return folder
