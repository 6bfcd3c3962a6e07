"""Bounded reads of regular files: the one way to open a file of a user.

A pipe, a socket or a device is refused without waiting for it. No file fills the memory, and every
failure is an error of the caller's type.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from app.geometry import InputError, MarginGuardError

_LFS_POINTER = b"version https://git-lfs.github.com/spec/"

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_regular(path: Path, error: type[MarginGuardError] = InputError) -> BufferedReader:
    """Open the regular file at ``path`` for reading bytes; the caller closes it.

    Raises ``error`` for a file that cannot be opened and for anything but a regular file. The kind
    is that of the opened file, so that a file that is replaced meanwhile is not read. A pipe
    without a writer does not block.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except (OSError, ValueError) as problem:  # ValueError: a null character in the name
        reason = getattr(problem, "strerror", None) or problem
        raise error(f"{path} cannot be read: {reason}") from problem
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind != stat.S_IFREG:
        os.close(descriptor)
        found = _KINDS.get(kind, "of an unknown kind")
        raise error(f"{path} cannot be read: it is {found}; expected a regular file")
    return os.fdopen(descriptor, "rb")


@contextmanager
def open_for_reading(
    path: Path, error: type[MarginGuardError] = InputError
) -> Iterator[BufferedReader]:
    """Open the regular file at ``path`` for reading bytes, see `open_regular`.

    An `OSError` of the body, too, becomes ``error``.
    """
    try:
        with open_regular(path, error) as file:
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
    check_is_content(content, path, error)
    return content


def read_text(path: Path, max_bytes: int, encoding: str = "utf-8") -> str:
    """Read the file at ``path`` as `read_bounded`; `InputError` for other text than UTF-8."""
    try:
        return read_bounded(path, max_bytes).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: byte {error.start}") from error


def check_is_content(start: bytes, path: Path, error: type[MarginGuardError] = InputError) -> None:
    """Raise ``error`` if the first bytes of the file at ``path`` are a pointer of Git LFS."""
    if start.startswith(_LFS_POINTER):
        raise error(
            f"{path} is a pointer of Git LFS to a file that is not here; expected the file itself: "
            "fetch it by 'git lfs pull'"
        )


def is_file(path: Path) -> bool:
    """True if ``path`` is a regular file; false, too, for a name that no file can have."""
    return stat.S_ISREG(_mode(path))


def is_folder(path: Path) -> bool:
    """True if ``path`` is a folder; false, too, for a name that no folder can have."""
    return stat.S_ISDIR(_mode(path))


def _mode(path: Path) -> int:
    """Mode of the file with links followed, 0 where there is none.

    `Path.is_file` raises an `OSError` for a name of more than 255 bytes.
    """
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0
