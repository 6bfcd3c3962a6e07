"""Fast CDR decoding for messages that repeat: the layout of one message is reused for the next.

A source sends the same names again and again, so that its messages differ in their numbers alone.
The first message is walked value by value. The `struct` format found on the way then unpacks all
messages of that length at once, each value of all of them as one column.

Layout: plain CDR (OMG DDS-XTypes 1.3, section 7.4.1). Four bytes of encapsulation come first. Every
value lies at a multiple of its own size, counted from the end of the encapsulation.
"""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Generic, TypeVar

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


Values = TypeVar("Values")
Known = Mapping[bytes, Any]
"""Constant stretches of bytes, and the names that they stand for."""

_ENCAPSULATION = 4
_BYTE_ORDERS = {b"\0\0": ">", b"\0\1": "<"}
_COUNTS = {order: struct.Struct(f"{order}I") for order in _BYTE_ORDERS.values()}
_COUNT_BYTES = 4
_MAX_PADDING = 3
"""Bytes after the last value that bring a message to a multiple of four."""
_MAX_KNOWN = 1024
_MAX_MESSAGE_BYTES = 16 * 1024
"""Beyond either all layouts are discarded, so that a hostile source cannot fill the memory."""


class Walk:
    """Reads one message value by value and records its layout.

    Raises `ValueError` or `struct.error` where the bytes are not such a message.
    """

    def __init__(self, data: bytes) -> None:
        order = _BYTE_ORDERS[data[:2]]
        self._codes = [f"{order}{_ENCAPSULATION}x"]
        self._count = _COUNTS[order]
        self._body = data[_ENCAPSULATION:]
        self._at = self._begin = 0

    def count(self, item_bytes: int = 0) -> int:
        """Length of the sequence or string that follows; its items have ``item_bytes`` or more."""
        self.align(_COUNT_BYTES)
        (count,) = self._count.unpack_from(self._body, self._at)
        if count * item_bytes > len(self._body):
            raise ValueError(f"its {len(self._body)} bytes cannot hold {count} items")
        self._at += _COUNT_BYTES
        return int(count)

    def text(self, max_bytes: int | None = None) -> str:
        """A string, of ``max_bytes`` or less with its terminating zero."""
        count = self.count()
        end = self._at + count
        if count == 0 or (max_bytes is not None and count > max_bytes):
            expected = "1 or more" if max_bytes is None else f"1 to {max_bytes}"
            raise ValueError(f"it has a name of {count} bytes; expected {expected}")
        if end > len(self._body):
            raise ValueError("it ends within a name")
        if self._body[end - 1] != 0:
            raise ValueError("it has a name without its terminating zero")
        text = self._body[self._at : end - 1].decode()
        self._at = end
        return text

    def align(self, size: int) -> None:
        """Advance to a multiple of ``size``."""
        self._at = -(-self._at // size) * size

    def fixed(self) -> bytes:
        """The bytes between the last numbers and here, the same in every message of this layout."""
        stretch = self._body[self._begin : self._at]
        self._codes.append(f"{len(stretch)}s")
        self._begin = self._at
        return stretch

    def numbers(self, code: str, size: int) -> None:
        """Skip numbers with the `struct` format ``code``, ``size`` bytes in all; ``x`` drops them.

        They follow directly after numbers or after `fixed`.
        """
        self._codes.append(code)
        self._at += size
        self._begin = self._at

    def end(self) -> str:
        """The `struct` format of the whole message, which has no more values."""
        rest = len(self._body) - self._at
        if rest < 0:
            raise ValueError(f"its last {-rest} bytes are missing")
        if rest > _MAX_PADDING:
            raise ValueError(
                f"it has {rest} bytes after the last value; expected 0 to {_MAX_PADDING}"
            )
        self._codes.append(f"{rest}x")
        return "".join(self._codes)


@dataclass(slots=True)
class _Layout:
    codes: str
    unpack: Callable[[bytes], tuple[Any, ...]]
    known: dict[bytes, Any] = field(default_factory=dict)


class LayoutReader(Generic[Values]):
    """Reads messages of one type. Not thread-safe.

    ``walk`` walks over a message and returns the names of its fixed stretches. ``values`` takes the
    numbers and fixed stretches of a message in their order, and the known stretches; it raises
    `KeyError` for an unknown stretch.
    """

    def __init__(
        self, walk: Callable[[Walk], Known], values: Callable[[tuple[Any, ...], Known], Values]
    ) -> None:
        self._walk = walk
        self._values = values
        self._layouts: dict[bytes, dict[int, _Layout]] = {order: {} for order in _BYTE_ORDERS}
        self._known_count = 0

    def __call__(self, data: bytes) -> Values | None:
        """The values of a message; None for bytes that are not such a message."""
        try:
            return self.read(data)
        except ValueError:
            return None

    def read(self, data: bytes) -> Values:
        """The values of a message; `ValueError` with the reason for other bytes."""
        layouts = self._layouts.get(data[:2])
        if layouts is None:
            raise ValueError(f"it begins with {data[:2].hex() or 'nothing'}; expected 0000 or 0001")
        layout = layouts.get(len(data))
        if layout is not None:
            try:
                return self._values(layout.unpack(data), layout.known)
            except KeyError:
                pass  # new names in a known layout
        try:
            layout = self._learn(data)
        except struct.error as error:
            raise ValueError(str(error)) from error
        return self._values(layout.unpack(data), layout.known)

    def batch(
        self,
        messages: Sequence[bytes],
        decode: Callable[[MessageColumns, str, Known], list[Any]],
    ) -> list[Any]:
        """Results of ``decode`` for ``messages`` of one length, None for each that it cannot read.

        ``decode`` takes their columns, the `struct` format of the layout that is known for this
        length, and the known stretches. Learns no layout: where none is known all are None.
        """
        order, length = messages[0][:2], len(messages[0])
        layout = self._layouts.get(order, {}).get(length)
        if layout is None:
            return [None] * len(messages)
        columns = MessageColumns(messages, layout.codes[0])
        found = decode(columns, layout.codes, layout.known)
        has_order = columns.equal(0, order)
        if has_order.all():
            return found
        return [each if same else None for each, same in zip(found, has_order, strict=True)]

    def _learn(self, data: bytes) -> _Layout:
        walk = Walk(data)
        known = self._walk(walk)
        codes = walk.end()
        if len(data) > _MAX_MESSAGE_BYTES or self._known_count + len(known) > _MAX_KNOWN:
            for each in self._layouts.values():
                each.clear()
            self._known_count = 0
        layouts = self._layouts[data[:2]]
        layout = layouts.get(len(data))
        if layout is None or layout.codes != codes:
            layout = _Layout(codes, struct.Struct(codes).unpack)
            layouts[len(data)] = layout
        layout.known.update(known)
        self._known_count += len(known)
        return layout
