"""Columns of many CDR messages of one layout: each value of all of them as one array.

The layout is one that `app.case.messages.cdr_layout` has learned from a message.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TYPES = {"i": "i4", "I": "u4", "d": "f8", "B": "u1"}
_BYTES = {"i": 4, "I": 4, "d": 8, "B": 1, "s": 1, "x": 1}
_ITEM = re.compile(r"(\d*)([a-zA-Z])")
_MAX_STRETCHES = 8
"""Different stretches at one place that are looked up; messages with others have no names."""


@dataclass(frozen=True, slots=True)
class Column:
    """Bytes ``begin`` to ``end`` of each message: numbers of a `struct` ``code``, or a stretch."""

    code: str
    begin: int
    end: int


@lru_cache(maxsize=256)
def columns_of(codes: str) -> tuple[Column, ...]:
    """The columns of a `struct` format without alignment, in order; padding has none."""
    found = []
    at = 0
    for count, code in _ITEM.findall(codes):
        size = _BYTES[code] * (int(count) if count else 1)
        if code != "x":
            found.append(Column(code, at, at + size))
        at += size
    return tuple(found)


class MessageColumns:
    """``messages`` of one length, at least one, in the ``byte_order`` of `struct`."""

    def __init__(self, messages: Sequence[bytes], byte_order: str) -> None:
        self._bytes = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), -1)
        self._order = byte_order

    def __len__(self) -> int:
        return len(self._bytes)

    def equal(self, begin: int, expected: bytes) -> NDArray[np.bool_]:
        """(n,): whether each message has the bytes ``expected`` from ``begin`` on."""
        there = self._bytes[:, begin : begin + len(expected)]
        same: NDArray[np.bool_] = (there == np.frombuffer(expected, np.uint8)).all(axis=1)
        return same

    def numbers(self, column: Column) -> NDArray[Any]:
        """(n, count) numbers of ``column``; a new array."""
        values = np.ascontiguousarray(self._bytes[:, column.begin : column.end])
        return values.view(self._order + _TYPES[column.code])

    def known(self, columns: Sequence[Column], names: Mapping[bytes, Any]) -> list[Any]:
        """The value in ``names`` of the joined bytes of ``columns``, or None, for each message."""
        found: list[Any] = [None] * len(self)
        left = np.ones(len(self), np.bool_)
        for _ in range(_MAX_STRETCHES):
            first = int(left.argmax())
            if not left[first]:
                break
            row = self._bytes[first]
            parts = [row[each.begin : each.end].tobytes() for each in columns]
            same = left.copy()
            for column, part in zip(columns, parts, strict=True):
                if part:
                    same &= self.equal(column.begin, part)
            left &= ~same
            value = names.get(b"".join(parts))
            if value is not None:
                if same.all():
                    return [value] * len(self)
                for index in np.flatnonzero(same).tolist():
                    found[index] = value
        return found
