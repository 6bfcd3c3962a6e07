"""Bounded reads: no file fills the memory, and every failure is an error of the caller's type."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from app.geometry import InputError, MarginGuardError


@contextmanager
def open_for_reading(path: Path, error: type[MarginGuardError] = InputError) -> Iterator[IO[bytes]]:
    """Open the file at ``path`` for reading bytes.

    An `OSError` of the body, too, becomes ``error``.
    """
    try:
        with path.open("rb") as file:
            yield file
    except OSError as problem:
        raise error(f"{path} cannot be read: {problem.strerror or problem}") from problem


def read_bounded(path: Path, max_bytes: int, error: type[MarginGuardError] = InputError) -> bytes:
    """Read the whole file at ``path``.

    Raises ``error`` for a file that cannot be read, and for one of more than ``max_bytes`` bytes.
    """
    with open_for_reading(path, error) as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise error(f"{path} has more than the {max_bytes} bytes allowed")
    return content
