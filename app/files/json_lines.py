"""An append-only file of JSON objects, one a line, each on the disk before the next is written."""

import json
import os
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Self

from app.geometry import InputError

MAX_BYTES = 8_000_000
"""Size at which a file is closed and renamed."""

KEPT = 5
"""Renamed files that are kept: ``NAME.1`` is the newest one."""


class JsonLinesFile:
    """Appends to ``path``; at ``max_bytes`` renames it to ``NAME.1`` and begins anew.

    The oldest of more than ``kept`` files is removed. Files are readable by their owner alone. A
    line that a crash has cut off is ended first, so that it damages no other. For one thread.
    Raises `InputError` if the file cannot be opened, and `OSError` if it cannot be written later.
    """

    def __init__(self, path: Path, *, max_bytes: int = MAX_BYTES, kept: int = KEPT) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._kept = kept
        try:
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            if path.exists() and not path.is_file():
                raise InputError(f"{path}: not a regular file; expected one, or a new name")
            self._descriptor = self._open()
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror}") from error

    def append(self, line: Mapping[str, object]) -> None:
        """Write ``line`` to the disk. Raises `OSError`."""
        raw = json.dumps(line, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        if self._bytes + len(raw) > self._max_bytes and self._bytes:
            self._rotate()
        self._write(raw)
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def _open(self) -> int:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK
        descriptor = os.open(self.path, flags, 0o600)
        self._bytes = os.fstat(descriptor).st_size
        if self._bytes:
            with self.path.open("rb") as written:
                written.seek(-1, os.SEEK_END)
                complete = written.read(1) == b"\n"
            if not complete:
                self._bytes += os.write(descriptor, b"\n")
        return descriptor

    def _write(self, raw: bytes) -> None:
        while raw:
            written = os.write(self._descriptor, raw)
            self._bytes += written
            raw = raw[written:]

    def _rotate(self) -> None:
        names = [self.path, *(Path(f"{self.path}.{n}") for n in range(1, self._kept + 1))]
        for old, new in reversed(list(pairwise(names))):
            if old.exists():
                old.replace(new)
        os.close(self._descriptor)
        self._descriptor = self._open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
