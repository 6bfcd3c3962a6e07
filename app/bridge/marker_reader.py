"""Reads ``visualization_msgs/MarkerArray`` as CDR bytes: making a `Point` each holds the GIL."""

import struct
from typing import NamedTuple

import numpy as np

from app.bridge.errors import BridgeError
from app.geometry import FloatArray

_HEADER_BYTES = 4
_POINT_BYTES, _COLOR_BYTES, _UV_BYTES = 24, 16, 8
_MAX_MARKERS = 1024
_FIXED = struct.Struct("<iii")


class MarkerShape(NamedTuple):
    """A marker: what it is for, and its points (n, 3) in m."""

    action: int
    type: int
    name: str
    text: str
    points_m: FloatArray


def read_marker_array(data: bytes) -> list[MarkerShape]:
    """The markers of a little-endian message; raises `BridgeError` for other bytes."""
    try:
        return _Reader(data).markers()
    except (ValueError, struct.error) as error:
        raise BridgeError(
            f"markers: {len(data)} bytes cannot be read: {error}; expected a MarkerArray"
        ) from error


class _Reader:
    """A place in a message; alignment is counted from the end of its header."""

    def __init__(self, data: bytes) -> None:
        if data[:2] != b"\x00\x01":
            raise ValueError("not little-endian CDR")
        self._data, self._at = memoryview(data)[_HEADER_BYTES:], 0

    def markers(self) -> list[MarkerShape]:
        count = self._count()
        if count > _MAX_MARKERS:
            raise ValueError(f"{count} markers")
        return [self._marker() for _ in range(count)]

    def _marker(self) -> MarkerShape:
        self._skip(4, 8)  # stamp
        self._bytes()  # frame
        name = self._text()
        self._align(4)
        _, kind, action = _FIXED.unpack_from(self._data, self._at)
        self._at += _FIXED.size
        self._skip(8, 10 * 8)  # pose, scale
        self._skip(4, 4 * 4 + 8)  # colour, lifetime
        self._skip(1, 1)  # locked to its frame
        points = self._points()
        self._sequence(4, _COLOR_BYTES)
        self._bytes()  # texture
        self._skip(4, 8)
        self._bytes()
        self._bytes()
        self._sequence(1, 1)
        self._sequence(4, _UV_BYTES)
        text = self._text()
        self._bytes()  # mesh
        self._bytes()
        self._sequence(1, 1)
        self._skip(1, 1)
        return MarkerShape(action, kind, name, text, points)

    def _points(self) -> FloatArray:
        start, count = self._sequence(8, _POINT_BYTES)
        end = start + _POINT_BYTES * count
        points = np.frombuffer(self._data[start:end], dtype="<f8").reshape(-1, 3)
        return np.asarray(points, dtype=np.float64)

    def _sequence(self, alignment: int, item_bytes: int) -> tuple[int, int]:
        """Skip a sequence; where its items begin, and their number."""
        count = self._count()
        if count:
            self._align(alignment)
        start = self._at
        self._advance(item_bytes * count)
        return start, count

    def _text(self) -> str:
        return self._bytes().removesuffix(b"\0").decode()

    def _bytes(self) -> bytes:
        start, count = self._sequence(1, 1)
        return bytes(self._data[start : start + count])

    def _count(self) -> int:
        self._align(4)
        (count,) = struct.unpack_from("<I", self._data, self._at)
        self._at += 4
        return int(count)

    def _skip(self, alignment: int, size: int) -> None:
        self._align(alignment)
        self._advance(size)

    def _align(self, size: int) -> None:
        self._at = -(-self._at // size) * size

    def _advance(self, size: int) -> None:
        self._at += size
        if self._at > len(self._data):
            raise ValueError(f"{self._at - len(self._data)} of them are missing")
