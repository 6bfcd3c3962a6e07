"""What a path names, also a path that is too long or malformed for the file system."""

from collections.abc import Callable
from pathlib import Path


def is_folder(path: Path) -> bool:
    """True for a folder; False where pathlib raises `OSError`, as for a name of 300 letters."""
    return _answer(path.is_dir)


def is_file(path: Path) -> bool:
    """True for a regular file; otherwise as `is_folder`."""
    return _answer(path.is_file)


def exists(path: Path) -> bool:
    """True for anything that exists; otherwise as `is_folder`."""
    return _answer(path.exists)


def _answer(question: Callable[[], bool]) -> bool:
    try:
        return question()
    except OSError:
        return False
