"""The images of one IGSIO sequence, each with its stamp, its status and the poses of its frame."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from app.case.images.current import ImagePose
from app.case.images.layout import ImageLayout, as_pixels, read_layout
from app.case.images.orientation import checked_orientation, to_standard
from app.case.images.pixel_file import PixelFile
from app.case.images.poses import FramePoses, matrix_between
from app.case.readers.igsio.header import (
    FrameFields,
    FrameNames,
    header_frames,
    is_transform,
    tracked_sample,
)
from app.files.bounded_io import open_for_reading
from app.geometry import (
    ImageCalibration,
    ImageSample,
    ImageStatus,
    InputError,
    Stamp,
    TrackingStatus,
)

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

    def __exit__(
        self, kind: type[BaseException] | None, value: object, trace: TracebackType | None
    ) -> None:
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
