"""Where in the bytes of a message its numbers lie: found once, for all messages laid out so.

A source says the same names over and over, so that its messages differ in their numbers alone.

Layout: plain CDR (OMG DDS-XTypes 1.3, section 7.4.1): 4 bytes of encapsulation, then every value
at a multiple of its own size, counted from behind them.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

Values = TypeVar("Values")
Known = Mapping[bytes, Any]
"""What stretches of bytes that are the same in every message stand for."""

_ENCAPSULATION = 4
_LITTLE_ENDIAN = b"\0\1"
_COUNT = struct.Struct("<I")
_PADDING = 3
"""So many bytes may follow a message, to a multiple of four."""
_MOST_KNOWN = 1024
_LONGEST = 16 * 1024
"""Where there are more or longer ones, all is forgotten: a hostile source fills no memory."""


class Walk:
    """Goes over one message, from value to value, and notes its layout.

    What the bytes do not hold raises `ValueError` or `struct.error`.
    """

    def __init__(self, data: bytes) -> None:
        self._codes = [f"<{_ENCAPSULATION}x"]
        self._body = data[_ENCAPSULATION:]
        self._at = self._begin = 0

    def count(self) -> int:
        """The length of what follows."""
        self.align(_COUNT.size)
        (count,) = _COUNT.unpack_from(self._body, self._at)
        self._at += _COUNT.size
        return int(count)

    def text(self) -> str:
        """A name."""
        count = self.count()
        end = self._at + count
        if count == 0 or self._body[end - 1 : end] != b"\0":
            raise ValueError("no zero closes the name")
        text = self._body[self._at : end - 1].decode()
        self._at = end
        return text

    def align(self, size: int) -> None:
        """Go on to a multiple of ``size``."""
        self._at = -(-self._at // size) * size

    def fixed(self) -> bytes:
        """What lies between the last numbers and here, the same in every such message."""
        stretch = self._body[self._begin : self._at]
        self._codes.append(f"{len(stretch)}s")
        self._begin = self._at
        return stretch

    def numbers(self, code: str, size: int) -> None:
        """Numbers by their code of `struct`, of so many bytes in all; ``x`` for what is left out.

        They follow on numbers or on `fixed`.
        """
        self._codes.append(code)
        self._at += size
        self._begin = self._at

    def end(self) -> str:
        """The layout, in codes of `struct`, of a message that has no more values."""
        rest = len(self._body) - self._at
        if not 0 <= rest <= _PADDING:
            raise ValueError(f"{rest} bytes behind the last value: 0 to {_PADDING} wanted")
        self._codes.append(f"{rest}x")
        return "".join(self._codes)


@dataclass(slots=True)
class _Layout:
    codes: str
    unpack: Callable[[bytes], tuple[Any, ...]]
    known: dict[bytes, Any] = field(default_factory=dict)


class LayoutReader(Generic[Values]):
    """Reads messages of one type.

    ``walk`` goes over a message and gives what its fixed stretches stand for. ``values`` takes the
    message's numbers and fixed stretches in their order, and what stretches are known; it raises
    `KeyError` for others.
    """

    def __init__(
        self, walk: Callable[[Walk], Known], values: Callable[[tuple[Any, ...], Known], Values]
    ) -> None:
        self._walk = walk
        self._values = values
        self._layouts: dict[int, _Layout] = {}
        self._known_count = 0

    def __call__(self, data: bytes) -> Values | None:
        """The values of a message; None for bytes that are none, or have another byte order."""
        if not data.startswith(_LITTLE_ENDIAN):
            return None
        layout = self._layouts.get(len(data))
        if layout is not None:
            try:
                return self._values(layout.unpack(data), layout.known)
            except KeyError:
                pass  # names that have not been said before
        try:
            layout = self._learnt(data)
        except (struct.error, ValueError):
            return None
        return self._values(layout.unpack(data), layout.known)

    def _learnt(self, data: bytes) -> _Layout:
        walk = Walk(data)
        known = self._walk(walk)
        codes = walk.end()
        if len(data) > _LONGEST or self._known_count + len(known) > _MOST_KNOWN:
            self._layouts.clear()
            self._known_count = 0
        layout = self._layouts.get(len(data))
        if layout is None or layout.codes != codes:
            layout = _Layout(codes, struct.Struct(codes).unpack)
            self._layouts[len(data)] = layout
        layout.known.update(known)
        self._known_count += len(known)
        return layout
