"""Numbers of text files, in plain decimal form, which every program reads alike."""

import csv
from pathlib import Path

import numpy as np

from app.files.bounded_io import read_text
from app.geometry import FloatArray, InputError, MarginGuardError, Stamp, is_plain_number


def parse_numbers(text: str, count: int, place: str) -> list[float]:
    """Parse ``count`` numbers separated by white space.

    NaN and infinities are accepted; the caller decides about them. Raises `InputError`, with
    ``place``, for another count and for a word that is not a plain decimal number.
    """
    words = text.split()
    if len(words) != count:
        raise InputError(f"{place} has {len(words)} numbers; expected {count}")
    if is_plain_number(text):
        try:
            return [float(word) for word in words]
        except ValueError:
            pass  # reported below with the word
    raise InputError(f"{place}: {next(filter(_is_invalid, words))!r} is not a number")


def _is_invalid(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return True
    return not is_plain_number(word)


SIGNAL_ENDING = ".csv"
_MAX_BYTES = 64_000_000
_MAX_COLUMNS = 64


def read_signal(path: Path) -> tuple[list[int], FloatArray]:
    """Read times in ns and values (n, d) of the table at ``path``.

    Each line has the time in s, then one or more values, separated by commas. Programs that measure
    something in a video write such a table: the position of a line in each image, for example. A
    first line with names is skipped.

    Raises `InputError`, with the line, for a table that is not one of numbers.
    """
    text = read_text(path, _MAX_BYTES, "utf-8-sig")
    times: list[int] = []
    values: list[list[float]] = []
    try:
        for number, row in enumerate(csv.reader(text.splitlines(), strict=True), start=1):
            if not row or (number == 1 and _is_header(row)):
                continue
            place = f"{path} line {number}"
            if not 2 <= len(row) <= _MAX_COLUMNS or (values and len(row) != len(values[0]) + 1):
                expected = len(values[0]) + 1 if values else f"2 to {_MAX_COLUMNS}"
                raise InputError(f"{place} has {len(row)} columns; expected {expected}")
            times.append(parse_stamp(row[0], place).ns)
            values.append(parse_numbers(" ".join(row[1:]), len(row) - 1, place))
    except csv.Error as error:
        raise InputError(f"{path} is not a table: {error}") from error
    if not times:
        raise InputError(f"{path} holds no numbers; expected lines of a time in s and values")
    return times, np.array(values)


def _is_header(row: list[str]) -> bool:
    try:
        parse_numbers(" ".join(row), len(row), "")
    except InputError:
        return True
    return False


def parse_stamp(text: str, place: str) -> Stamp:
    """Parse a time in s. Raises `InputError`, with ``place``, for another text."""
    try:
        return Stamp.from_seconds(text)
    except MarginGuardError as error:
        raise InputError(f"{place}: {error}") from error
