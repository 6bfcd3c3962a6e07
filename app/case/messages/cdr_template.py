"""Bytes of serialised messages that differ in stamps and numbers only.

A general serialiser converts a message field by field; a recording has thousands of messages whose
names are the same. The layout is CDR in little-endian order: each field is aligned to its size,
counted from the end of the encapsulation's four bytes.
"""

import struct
from collections.abc import Iterable, Sequence
from typing import Self

from app.geometry import NS_PER_S, InputError

_ENCAPSULATION = b"\0\1\0\0"
_STAMP = struct.Struct("<iI")
_SEC_LIMIT = 2**31

Block = tuple[int, Sequence[float]]
"""A stamp in ns, and the numbers that follow it."""


def stamp_parts(ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a ROS time; raises `InputError` for one that does not fit."""
    sec, nanosec = divmod(ns, NS_PER_S)
    if not -_SEC_LIMIT <= sec < _SEC_LIMIT:
        raise InputError(f"stamp is {ns} ns; expected a ROS time, within 2^31 s of 0")
    return sec, nanosec


class CdrTemplate:
    """A message that is built field by field, with places for stamps and 64-bit numbers."""

    def __init__(self) -> None:
        self._raw = bytearray(_ENCAPSULATION)
        self._stamps: list[int] = []
        self._numbers: list[tuple[struct.Struct, int]] = []

    def stamp(self) -> Self:
        """Add a ``builtin_interfaces/Time``."""
        self._align(4)
        self._stamps.append(len(self._raw))
        self._raw += bytes(_STAMP.size)
        return self

    def text(self, text: str) -> Self:
        """Add a string."""
        data = text.encode() + b"\0"
        self.count(len(data))
        self._raw += data
        return self

    def count(self, number: int) -> Self:
        """Add an unsigned number of 32 bits, such as the length of a sequence."""
        self._align(4)
        self._raw += struct.pack("<I", number)
        return self

    def byte(self, number: int) -> Self:
        """Add an unsigned number of 8 bits."""
        self._raw.append(number)
        return self

    def numbers(self, count: int) -> Self:
        """Add ``count`` floating-point numbers."""
        if count:
            self._align(8)
        self._numbers.append((struct.Struct(f"<{count}d"), len(self._raw)))
        self._raw += bytes(8 * count)
        return self

    def serialized(self, blocks: Iterable[Block]) -> bytes:
        """The message with these stamps and numbers, one block for each place of both."""
        raw = self._raw
        for (ns, values), at, (layout, begin) in zip(
            blocks, self._stamps, self._numbers, strict=True
        ):
            _STAMP.pack_into(raw, at, *stamp_parts(ns))
            layout.pack_into(raw, begin, *values)
        return bytes(raw)

    def _align(self, size: int) -> None:
        self._raw += bytes((len(_ENCAPSULATION) - len(self._raw)) % size)
