"""Options that several commands share, and types of options."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from app.files.paths import input_path, split_package_dir
from app.geometry import InputError

CASE_HELP = "folder with a case.yaml; package://marginguard/recorded_case is the shipped case"
LIVE_EXAMPLE = "package://marginguard/live_example/live.yaml"

MAX_AGE_MS = 60_000.0
MAX_RATE_HZ = 20_000.0
MAX_OFFSET_MS = 4e12
_MAX_DIGITS = 18
"""More than a century: one clock may count from 1970, and the other from its own start."""


def add_case(parser: argparse.ArgumentParser) -> None:
    """Add the case folder and the folders of packages."""
    parser.add_argument("case", type=input_argument, metavar="CASE", help=CASE_HELP)
    add_package_dirs(parser)


def add_package_dirs(parser: argparse.ArgumentParser) -> None:
    """Add the folders in which ``package://`` names are resolved."""
    parser.add_argument(
        "--package-dir",
        type=package_folder,
        action="append",
        default=[],
        metavar="DIR",
        dest="package_dirs",
        help="where package://NAME/... is found: the folder of the package (its package.xml names "
        "it), a folder that contains it, or NAME=FOLDER; may be repeated",
    )


def add_tool(parser: argparse.ArgumentParser) -> None:
    """Add the choice of one of several tools."""
    parser.add_argument(
        "--tool", metavar="NAME", help="guard this tool of a case with several (schema 2)"
    )


def add_tip_only(parser: argparse.ArgumentParser) -> None:
    """Add the check of the tip alone."""
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add output for programs."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def input_argument(text: str) -> Path:
    """Path of an input, also of shipped data: ``package://marginguard/...``."""
    _check_not_empty(text)
    try:
        return input_path(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add the ROS namespace of the node ``marginguard``."""
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="ROS namespace of the session's node"
    )


def add_audit(parser: argparse.ArgumentParser) -> None:
    """Add the file of the audit log of a live session."""
    parser.add_argument(
        "--audit",
        type=output_path,
        metavar="FILE",
        help="append the audit log of the live session to this file: docs/audit_log.md; default: "
        "a file below $XDG_STATE_HOME/marginguard, which the log of the node names",
    )


def add_cases(parser: argparse.ArgumentParser) -> None:
    """Add the folder of the recordings of a live session."""
    parser.add_argument(
        "--cases",
        type=folder_path,
        metavar="DIR",
        help="folder of the recordings that an operator starts on the page or by ~/record; "
        "default: $XDG_STATE_HOME/marginguard/cases",
    )


def output_path(text: str) -> Path:
    """Path of a file to be written."""
    _check_not_empty(text)
    return Path(text)


def folder_path(text: str) -> Path:
    """Path of a folder. An empty text is refused: a script has made a mistake."""
    _check_not_empty(text)
    if text.startswith("package://"):
        raise argparse.ArgumentTypeError(f"{text!r} names shipped data; expected another folder")
    return Path(text)


def package_folder(text: str) -> Path:
    """Path of an existing folder of packages, or ``NAME=FOLDER`` for that of one package."""
    name, folder = split_package_dir(folder_path(text))
    if name is None:
        return existing_folder(text)
    return Path(f"{name}={existing_folder(str(folder))}")


def existing_folder(text: str) -> Path:
    """Path of an existing folder; checked before anything is read."""
    path = folder_path(text)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r}: no such folder; expected an existing one")
    return path


def file_path(*endings: str) -> Callable[[str], Path]:
    """Type of an option for an output file whose name ends with one of ``endings``."""

    def checked(text: str) -> Path:
        if not text.lower().endswith(endings) or Path(text).name.lower() in endings:
            raise argparse.ArgumentTypeError(
                f"{text!r}; expected a file name that ends with {' or '.join(endings)}"
            )
        return Path(text)

    checked.is_file_path = True  # type: ignore[attr-defined]  # for `doctor completion`
    return checked


def _check_not_empty(text: str) -> None:
    if not text:
        raise argparse.ArgumentTypeError("the name is empty; expected a path")


def number(text: str) -> float:
    """A number, possibly infinite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; expected a number")
    return value


def _in_range(expected: str, is_allowed: Callable[[float], bool]) -> Callable[[str], float]:
    def checked(text: str) -> float:
        value = number(text)
        if not is_allowed(value):
            raise argparse.ArgumentTypeError(f"{text!r} is out of range; expected {expected}")
        return value

    return checked


age_ms = _in_range(f"0 to {MAX_AGE_MS:g} ms", lambda ms: 0.0 <= ms <= MAX_AGE_MS)
"""A time difference in ms, 0 to `MAX_AGE_MS`."""

clock_offset_ms = _in_range(
    f"-{MAX_OFFSET_MS:g} to {MAX_OFFSET_MS:g} ms", lambda ms: abs(ms) <= MAX_OFFSET_MS
)
"""A clock offset in ms, at most `MAX_OFFSET_MS` in size."""

rate_hz = _in_range(
    f"more than 0 and at most {MAX_RATE_HZ:g} Hz", lambda hz: 0.0 < hz <= MAX_RATE_HZ
)
"""A rate in Hz, above 0 and at most `MAX_RATE_HZ`."""


def quantity(
    unit: str, expected: str, is_allowed: Callable[[float], bool]
) -> Callable[[str], float]:
    """Type of an option for a number in ``unit`` for which ``is_allowed`` is true."""

    def checked(text: str) -> float:
        try:
            value = float(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"{text!r} {unit}; expected a number") from error
        if not is_allowed(value):
            raise argparse.ArgumentTypeError(f"{text} {unit}; expected {expected}")
        return value

    return checked


def integer(
    low: int, high: int = 10**_MAX_DIGITS - 1, *, expected: str = "", unit: str = ""
) -> Callable[[str], int]:
    """Type of an option for ``low`` to ``high``, in digits alone; ``expected`` is in the error."""

    def checked(text: str) -> int:
        is_short = text.isascii() and text.isdecimal() and len(text) <= _MAX_DIGITS
        if not (is_short and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(
                f"{text!r}{unit}; expected {expected or f'{low} to {high}'}"
            )
        return int(text)

    return checked


def frame_name(text: str) -> str:
    """The name of a frame, not empty."""
    if not text:
        raise argparse.ArgumentTypeError("name of the frame is empty; expected a frame name")
    return text
