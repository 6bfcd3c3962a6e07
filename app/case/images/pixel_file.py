"""Reads the bytes of one image at a time from raw or deflated data."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BufferedReader
from typing import Any

from app.case.images.layout import ImageLayout, total_bytes
from app.files.bounded_io import open_regular
from app.geometry import InputError

_CHUNK_BYTES = 1 << 16
_MAX_RATIO = 1040
"""Deflate makes data at most 1032 times smaller."""
_MAX_POINTS = 64
"""Places from which a deflated sequence can be read again: 64 copies of a window of 32 KiB."""
_ANY_HEADER = 47  # zlib's or gzip's


class PixelFile:
    """The stored images of ``layout``; holds its file open until `close`.

    ``path`` names the sequence in messages. A raw image is read by its position. Deflated data are
    unpacked in their order; an earlier image is read again from one of 64 saved places. Raises
    `InputError` where the data are shorter or longer than the header declares. Not thread-safe.
    """

    def __init__(self, layout: ImageLayout, path: object) -> None:
        self._layout, self._path = layout, path
        self._file: BufferedReader = open_regular(layout.data_path)
        try:
            self._check_size()
            self._inflate = _Inflate(self._file, layout, self._cut) if layout.compressed else None
        except BaseException:
            self._file.close()
            raise

    def read(self, number: int) -> bytes:
        """The bytes of image ``number``, from 0, unpacked."""
        size = self._layout.image_bytes
        try:
            if self._inflate is not None:
                return self._inflate.image(number)
            self._file.seek(self._layout.offset + number * size)
            content = self._file.read(size)
        except (OSError, zlib.error) as error:
            raise InputError(f"{self._path}: image {number} cannot be read: {error}") from error
        if len(content) != size:
            raise self._cut(number)
        return content

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _check_size(self) -> None:
        layout = self._layout
        total = total_bytes(layout)
        found = max(0, self._file.seek(0, 2) - layout.offset)
        declared = f"{layout.count} images of {layout.columns} x {layout.rows}"
        if not layout.compressed and found != total:
            raise InputError(
                f"{self._path}: {layout.data_path.name} has {found} bytes of pixels; expected "
                f"{total}: {declared}, {layout.image_bytes} bytes each"
            )
        if layout.compressed and found < (layout.stored_bytes or 0):
            raise InputError(
                f"{self._path}: {layout.data_path.name} is cut: it has {found} bytes of compressed "
                f"pixels; expected {layout.stored_bytes}"
            )
        if layout.compressed and found * _MAX_RATIO < total:
            raise InputError(
                f"{self._path}: {found} bytes of compressed pixels cannot hold {declared}, "
                f"{total} bytes"
            )

    def _cut(self, number: int) -> InputError:
        return InputError(
            f"{self._path}: its pixels are cut or damaged at image {number}; expected "
            f"{self._layout.count} images"
        )


@dataclass(slots=True)
class _Place:
    """A state of the decompressor from which image ``number`` can be read."""

    number: int
    offset: int
    pending: bytes
    unpacker: Any


class _Inflate:
    """Unpacks deflated images in their order, and again from a saved place."""

    def __init__(
        self, file: BufferedReader, layout: ImageLayout, cut: Callable[[int], InputError]
    ) -> None:
        self._file, self._layout, self._cut = file, layout, cut
        start = _Place(0, layout.offset, b"", zlib.decompressobj(_ANY_HEADER))
        self._places = [start]
        self._step = max(1, -(-layout.count // _MAX_POINTS))
        self._go_to(start)

    def image(self, number: int) -> bytes:
        """Unpack image ``number``; those between the present one and it are unpacked, too."""
        best = max((each for each in self._places if each.number <= number), key=_number_of)
        if not best.number <= self._now <= number:
            self._go_to(best)
        while True:
            content = self._next()
            if self._now == number + 1:
                return content

    def _go_to(self, place: _Place) -> None:
        self._now, self._pending = place.number, place.pending
        self._unpacker = place.unpacker.copy()
        self._file.seek(place.offset)

    def _next(self) -> bytes:
        """Unpack the present image; after an error the first image is the present one."""
        number = self._now
        try:
            content = self._unpacked(self._layout.image_bytes)
        except zlib.error:
            content = b""
        if len(content) < self._layout.image_bytes:
            self._go_to(self._places[0])
            raise self._cut(number)
        self._now += 1
        if self._now % self._step == 0 and self._now > self._places[-1].number:
            self._places.append(
                _Place(self._now, self._file.tell(), self._pending, self._unpacker.copy())
            )
        return content

    def _unpacked(self, size: int) -> bytes:
        """The next ``size`` bytes; fewer where the data end."""
        content = bytearray()
        while len(content) < size and not self._unpacker.eof:
            data = self._pending or self._file.read(_CHUNK_BYTES)
            added = self._unpacker.decompress(data, size - len(content))
            self._pending = self._unpacker.unconsumed_tail
            content += added
            if not data and not added:
                break
        return bytes(content)


def _number_of(place: _Place) -> int:
    return place.number
