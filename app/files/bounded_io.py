"""Small files: read with a bound, written whole or not at all."""

import tempfile
from pathlib import Path

from app.geometry import InputError


def read_small(path: Path, max_bytes: int) -> bytes:
    """The bytes of ``path``; `InputError` when it cannot be read or is larger than allowed."""
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    if len(content) > max_bytes:
        raise InputError(f"{path} has more than the {max_bytes} bytes allowed")
    return content


def write_small(path: Path, content: bytes) -> None:
    """Put ``content`` at ``path``, in place of what was there; `InputError` when it cannot."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)


def check_place(path: Path) -> None:
    """Raise `InputError` unless a file can stand at ``path``: ask before the work is done."""
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"{path} cannot be written: a file in a folder that is there wanted")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
