"""The images of one IGSIO sequence, each with its stamp, its status and the poses of its frame."""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Self

import numpy as np

from app.case.images.current_image import ImagePose
from app.case.images.image_layout import (
    ImageLayout,
    as_pixels,
    checked_orientation,
    read_layout,
    to_standard,
)
from app.case.readers.igsio.igsio_header import (
    FrameFields,
    FrameNames,
    header_frames,
    is_transform,
    tracked_sample,
)
from app.files.bounded_io import open_for_reading, open_regular
from app.geometry import (
    Edge,
    FloatArray,
    ImageCalibration,
    ImageSample,
    ImageStatus,
    InputError,
    Stamp,
    TrackingStatus,
    shortest_path,
)

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
        total = layout.count * layout.image_bytes
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
        best = [each for each in self._places if each.number <= number][-1]
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


FramePoses = dict[Edge, FloatArray | TrackingStatus]
"""(target, source) to a matrix (4, 4), or to the status of a pose that is lost."""


def matrix_between(poses: FramePoses, target: str, source: str) -> FloatArray | str:
    """Return ``target_from_source`` (4, 4) through ``poses``, or the reason why it is not known.

    The path with the fewest poses is used.
    """
    known = {edge: pose for edge, pose in poses.items() if not isinstance(pose, TrackingStatus)}
    path = shortest_path(known, source, target)
    if path is not None:
        found, frame = np.eye(4), source
        for parent, child in path:
            pose = known[parent, child]
            found = (pose if child == frame else np.linalg.inv(pose)) @ found
            frame = parent if child == frame else child
        return found
    lost = [
        f"{parent} -> {child} is {pose.name}"
        for (parent, child), pose in poses.items()
        if isinstance(pose, TrackingStatus)
    ]
    return ", ".join(lost) or f"no pose connects {target!r} with {source!r}"


_MAX_FIELDS = 1024
_MAX_POSES = 500_000
_NO_TIME = Stamp(0)


@dataclass(slots=True)
class ImageEntry:
    """Fields of the header about one image and its frame."""

    stamp: Stamp | None = None
    status: ImageStatus = ImageStatus.OK
    poses: FramePoses = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class ImageHeader:
    """The header of a sequence. ``layout`` is None for a file without pixels.

    ``entries``: one per image, also for one that has no fields. ``spare``: the number of frames
    with fields beyond the last image: poses without an image.
    """

    path: Path
    layout: ImageLayout | None
    entries: tuple[ImageEntry, ...]
    spare: int
    notes: tuple[str, ...]


def read_image_header(path: Path) -> ImageHeader:
    """Read the header of the sequence at ``path``, without its pixels.

    A missing status of an image counts as OK, as in PLUS. Raises `InputError` for malformed text,
    images that are not read (`read_layout`), and more than 500,000 poses.
    """
    fields: dict[str, str] = {}

    def keep(key: str, value: str) -> None:
        if len(fields) < _MAX_FIELDS:
            fields.setdefault(key.lower(), value)

    notes: list[str] = []
    names = FrameNames(lambda text: notes.append(text) if len(notes) < 10 else None)
    found: dict[int, ImageEntry] = {}
    poses = 0
    with open_for_reading(path) as file:
        for frame in header_frames(file, str(path), keep):
            entry = found[frame.index] = _entry(frame, str(path), names)
            poses += 1 + len(entry.poses)
            if poses > _MAX_POSES:
                raise InputError(f"{path}: it has more poses than the {_MAX_POSES} allowed")
        layout = read_layout(fields, path, file.tell())
    count = 0 if layout is None else layout.count
    entries = tuple(found.pop(number, ImageEntry()) for number in range(count))
    return ImageHeader(path, layout, entries, len(found), tuple(notes))


def _entry(frame: FrameFields, path: str, names: FrameNames) -> ImageEntry:
    fields = frame.fields
    _, status = fields.get("ImageStatus", fields.get("Status", (0, "OK")))
    entry = ImageEntry(
        frame.stamp(path), ImageStatus.OK if status.upper() == "OK" else ImageStatus.INVALID
    )
    for name in filter(is_transform, fields):
        frames = names.of(name.removesuffix("Transform"))
        if frames is None:
            continue
        numbers, word = frame.matrix(path, name)
        sample = tracked_sample(numbers, word, frames, entry.stamp or _NO_TIME)
        edge = sample.target, sample.source
        matrix = np.array(numbers).reshape(4, 4)
        known = entry.poses.get(edge, matrix)  # two names may give the same frames
        is_known = not isinstance(known, TrackingStatus) and np.array_equal(known, matrix)
        if sample.status is TrackingStatus.OK:
            entry.poses[edge] = matrix if is_known else TrackingStatus.INVALID
        else:
            entry.poses[edge] = sample.status
    return entry


class ImageSequence:
    """The images at ``path``, read one at a time; a context manager that holds the file open.

    ``orientation`` is that of a file that names none. Raises `InputError` for a file without
    images, an orientation that is missing or contradicts the file's, and pixels that are shorter or
    longer than the header declares. Not thread-safe.

    Poses are used as the file prints them. The tracker's reader replaces the same numbers by the
    nearest rotation, which moves a point by the rounding of the file's digits (below 0.001 mm).
    """

    def __init__(self, path: Path, orientation: str | None = None) -> None:
        self.header = read_image_header(path)
        if self.header.layout is None:
            raise InputError(f"{path} holds no images; expected a sequence with pixels")
        self.layout = self.header.layout
        stated = self.layout.orientation
        given = orientation and checked_orientation(orientation, f"orientation for {path}")
        if given and stated and given != stated:
            raise InputError(
                f"{path}: the orientation of its images is {stated}; expected no other ({given})"
            )
        if not given and not stated:
            raise InputError(
                f"{path}: its header lacks UltrasoundImageOrientation; expected it, or the "
                "orientation of the images (images.orientation of a case.yaml, --orientation)"
            )
        self._orientation = str(stated or given)
        self._file = PixelFile(self.layout, path)

    def __len__(self) -> int:
        return self.layout.count

    def __iter__(self) -> Iterator[ImageSample]:
        return map(self.image, range(len(self)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def image(self, number: int) -> ImageSample:
        """Read image ``number``, from 0; its pixels only where its status is OK."""
        entry = self._entry(number)
        if entry.status is not ImageStatus.OK:
            return ImageSample(number, entry.stamp, entry.status, None)
        pixels = as_pixels(self._file.read(number), self.layout)
        return ImageSample(
            number, entry.stamp, entry.status, to_standard(pixels, self._orientation)
        )

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of every image, in MF."""
        columns, rows = self.layout.columns, self.layout.rows
        return (rows, columns) if self._orientation[0] in "FN" else (columns, rows)

    def pose(self, number: int, calibration: ImageCalibration, frame: str) -> ImagePose:
        """Where image ``number`` is in ``frame``, by the poses of its own frame of the header."""
        entry = self._entry(number)
        if entry.stamp is None:
            return ImagePose(None, f"image {number} has no Timestamp")
        if entry.status is not ImageStatus.OK:
            return ImagePose(None, f"image {number} has status {entry.status.name}")
        found = matrix_between(entry.poses, frame, calibration.probe)
        if isinstance(found, str):
            return ImagePose(None, f"image {number}: {found}")
        return ImagePose(found @ calibration.matrix)

    def _entry(self, number: int) -> ImageEntry:
        if not 0 <= number < len(self):
            raise InputError(
                f"{self.header.path}: image {number} does not exist; expected 0 to {len(self) - 1}"
            )
        return self.header.entries[number]
