"""JSON without duplicate names, and append-only files of JSON objects."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from app.files.atomic_io import writing
from app.files.bounded_io import read_bounded
from app.geometry import InputError


def read_json(path: Path, max_bytes: int) -> Any:
    """The values of the file at ``path``. Raises `InputError` if it cannot be read."""
    return parse_json(read_bounded(path, max_bytes), str(path))


def parse_json(content: str | bytes, place: str) -> Any:
    """The values of ``content``; ``place`` is for the message of the `InputError`."""
    try:
        return json.loads(content, object_pairs_hook=_unique_names)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{place} is not JSON: {error}") from error


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse duplicate names: Slicer takes the first of two values, Python the last."""
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ValueError(f"duplicate name among {', '.join(name for name, _ in pairs[:5])}")
    return values


MAX_BYTES = 8_000_000
"""Size at which a file is closed and renamed."""

_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK

KEPT = 5
"""Renamed files that are kept: ``NAME.1`` is the newest one."""


class JsonLinesFile:
    """Appends to ``path``; at ``max_bytes`` renames it to ``NAME.1`` and begins anew.

    The oldest of more than ``kept`` files is removed. Files are readable by their owner alone. A
    line that a crash has cut off is ended first, so that it damages no other. A file that cannot be
    replaced grows beyond ``max_bytes``. For one thread. Raises `InputError` if the file cannot be
    opened, and `OSError` if it cannot be written later.
    """

    def __init__(self, path: Path, *, max_bytes: int = MAX_BYTES, kept: int = KEPT) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._kept = kept
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            if path.exists() and not path.is_file():
                raise InputError(f"{path}: not a regular file; expected one, or a new name")
            self._descriptor, self._bytes = self._open()

    def append(self, line: Mapping[str, object]) -> None:
        """Write ``line`` to the disk. Raises `OSError`."""
        raw = json.dumps(line, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        if self._bytes + len(raw) > self._max_bytes and self._bytes:
            with suppress(OSError):  # the present file is still open
                self._rotate()
        self._write(raw)
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def _open(self) -> tuple[int, int]:
        """The descriptor of the file at ``path`` and its size."""
        descriptor = os.open(self.path, _FLAGS, 0o600)
        try:
            size = os.fstat(descriptor).st_size
            if size:
                with self.path.open("rb") as written:
                    written.seek(-1, os.SEEK_END)
                    complete = written.read(1) == b"\n"
                if not complete:
                    size += os.write(descriptor, b"\n")
        except BaseException:
            os.close(descriptor)
            raise
        return descriptor, size

    def _write(self, raw: bytes) -> None:
        while raw:
            written = os.write(self._descriptor, raw)
            self._bytes += written
            raw = raw[written:]

    def _rotate(self) -> None:
        """Continue in a new file, which takes the name only when it is open."""
        new = Path(f"{self.path}.new")
        new.unlink(missing_ok=True)
        descriptor = os.open(new, _FLAGS | os.O_EXCL, 0o600)
        try:
            if self.path.exists():
                names = [self.path, *(Path(f"{self.path}.{n}") for n in range(1, self._kept + 1))]
                for source, target in reversed(list(pairwise(names))):
                    if source.exists():
                        source.replace(target)
            new.replace(self.path)
        except BaseException:
            os.close(descriptor)
            raise
        full, self._descriptor, self._bytes = self._descriptor, descriptor, 0
        os.close(full)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
