"""Layout of images in a sequence metafile, and their orientation, normalised to MF.

IGSIO names the directions of columns and rows by letters: the first is where the column number
rises to, the second where the row number rises to. M: marked side of the probe, U: unmarked side,
F: far from the probe, N: near to it. A third letter, A or D, is the direction of the slices of a
volume; for a single slice it has no meaning. PLUS converts every image to MF when it reads a file,
and ``ImageToProbe`` is for that orientation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.files.paths import resolve_inside
from app.geometry import MAX_IMAGE_SIDE, ImageSample, InputError, Pixels

_SIDES = ("MF", "MN", "UF", "UN")
ORIENTATIONS = (*_SIDES, *(name[::-1] for name in _SIDES))
"""The eight orientations of one slice."""


def checked_orientation(text: str, where: str) -> str:
    """Return the two letters of ``text`` in capitals; `InputError`, with ``where``, for others."""
    name = text.strip().upper()
    if len(name) == 3 and name[2] in "AD":
        name = name[:2]
    if name not in ORIENTATIONS:
        raise InputError(
            f"{where} is {text[:60]!r}; expected {', '.join(ORIENTATIONS)}, also with A or D after "
            "it"
        )
    return name


def to_standard(pixels: Pixels, orientation: str) -> Pixels:
    """Return ``pixels`` (rows, columns, ...) of a checked ``orientation`` in MF.

    A copy only where something changes. RF lines (``FM``) become columns.
    """
    if orientation[0] in "FN":
        pixels = np.swapaxes(pixels, 0, 1)
        orientation = orientation[::-1]
    if orientation[0] == "U":
        pixels = pixels[:, ::-1]
    if orientation[1] == "N":
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def standard_image(image: ImageSample, orientation: str) -> ImageSample:
    """Return ``image`` of a checked ``orientation`` in MF; one without pixels as it is."""
    if image.pixels is None:
        return image
    pixel_mm = image.pixel_mm
    if pixel_mm is not None and orientation[0] in "FN":
        pixel_mm = pixel_mm[::-1]
    return replace(image, pixels=to_standard(image.pixels, orientation), pixel_mm=pixel_mm)


MAX_IMAGES = 100_000
MAX_IMAGE_BYTES = 1 << 25
"""Bytes of one image: 8192 x 4096 pixels of one byte."""

_TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2",
    "MET_UCHAR_ARRAY": "u1", "MET_CHAR_ARRAY": "i1", "MET_USHORT_ARRAY": "u2",
    "MET_SHORT_ARRAY": "i2", "uchar": "u1", "unsigned char": "u1", "uint8": "u1", "uint8_t": "u1",
    "signed char": "i1", "int8": "i1", "int8_t": "i1", "ushort": "u2", "unsigned short": "u2",
    "unsigned short int": "u2", "uint16": "u2", "uint16_t": "u2", "short": "i2", "short int": "i2",
    "signed short": "i2", "signed short int": "i2", "int16": "i2", "int16_t": "i2",
}  # fmt: skip
_COLOUR_KINDS = ("vector", "rgb-color", "3-color", "3-vector")
_LIST_KINDS = ("list", "time")
_IMAGE_TYPES = ("BRIGHTNESS", "RGB_COLOR")


@dataclass(frozen=True, slots=True)
class ImageLayout:
    """Where and how the images of one file are stored.

    ``columns``, ``rows``: of an image as stored, before its orientation is normalised. ``channels``
    is 1 or 3. ``dtype``: NumPy's name with its byte order. ``orientation``: two letters, None where
    the header names none. The data begin at byte ``offset`` of ``data_path``; they take
    ``stored_bytes``, None where the header does not say.
    """

    columns: int
    rows: int
    channels: int
    count: int
    dtype: str
    orientation: str | None
    compressed: bool
    data_path: Path
    offset: int
    stored_bytes: int | None

    @property
    def image_bytes(self) -> int:
        """Bytes of one image, unpacked."""
        return self.columns * self.rows * self.channels * np.dtype(self.dtype).itemsize


def read_layout(fields: Mapping[str, str], path: Path, header_bytes: int) -> ImageLayout | None:
    """Return the layout by the header's ``fields``; None for a file that holds no pixels.

    ``fields`` are those that belong to no frame; their keys are in lower case. Raises `InputError`
    for images that are not read: other types, volumes, lists of files, RF data.
    """
    nrrd = path.name.lower().endswith((".nrrd", ".nhdr"))
    kind = fields.get("ultrasound image type" if nrrd else "ultrasoundimagetype", "BRIGHTNESS")
    sizes = _integers(fields, "sizes" if nrrd else "dimsize", path)
    if not sizes or 0 in sizes:
        return None
    if kind.upper() not in _IMAGE_TYPES:
        raise InputError(
            f"{path}: the type of its images is {kind[:60]!r}; expected {', '.join(_IMAGE_TYPES)}"
        )
    found = _nrrd(fields, path, sizes) if nrrd else _metafile(fields, path, sizes)
    name, channels, columns, rows, count, big_endian, packed, file, stored = found
    if file is not None and (file.split(" ")[0].upper() == "LIST" or "%" in file):
        raise InputError(f"{path}: its images are in several files ({file[:60]}); expected one")
    code = _TYPES.get(name)
    if code is None or channels not in (1, 3) or (channels == 3 and not code.endswith("1")):
        raise InputError(
            f"{path}: its pixels have {channels} values of type {name[:60]!r}; expected one of 8 "
            "or 16 bits, or three of 8 bits"
        )
    if max(columns, rows) > MAX_IMAGE_SIDE or count > MAX_IMAGES:
        raise InputError(
            f"{path}: it declares {count} images of {columns} x {rows}; expected up to "
            f"{MAX_IMAGES} of {MAX_IMAGE_SIDE} on each side"
        )
    letters = fields.get("ultrasound image orientation" if nrrd else "ultrasoundimageorientation")
    orientation = (
        None
        if letters is None or letters.upper() == "XX"
        else checked_orientation(letters, f"{path}: the orientation of its images")
    )
    data_path = (
        path if file is None else resolve_inside(path.parent, file, f"{path}: its data file")
    )
    layout = ImageLayout(
        columns, rows, channels, count,
        code if code.endswith("1") else (">" if big_endian else "<") + code,
        orientation, packed, data_path, header_bytes if file is None else 0, stored,
    )  # fmt: skip
    if layout.image_bytes > MAX_IMAGE_BYTES:
        raise InputError(
            f"{path}: an image has {layout.image_bytes} bytes; expected {MAX_IMAGE_BYTES} or fewer"
        )
    return layout


_Found = tuple[str, int, int, int, int, bool, bool, str | None, int | None]


def _metafile(fields: Mapping[str, str], path: Path, sizes: list[int]) -> _Found:
    dimensions = fields.get("ndims", "")
    if dimensions != str(len(sizes)) or len(sizes) not in (2, 3, 4):
        raise InputError(
            f"{path}: NDims is {dimensions[:60]!r} and DimSize has {len(sizes)} numbers; expected "
            "2 to 4, the same"
        )
    columns, rows, *others = sizes
    depth = others[0] if len(others) == 2 else 1
    _check_depth(depth, path)
    if fields.get("headersize", "0") != "0":
        raise InputError(
            f"{path}: HeaderSize is {fields['headersize'][:60]!r}; expected data that begin at the "
            "start of their file, or right after the header"
        )
    if not _boolean(fields, "binarydata", path, default=True):
        raise InputError(f"{path}: its pixels are text; expected BinaryData = True")
    packed = _boolean(fields, "compresseddata", path, default=False)
    big_endian = any(
        _boolean(fields, key, path, default=False)
        for key in ("binarydatabyteordermsb", "elementbyteordermsb")
    )
    channels = _integers(fields, "elementnumberofchannels", path) or [1]
    file = fields.get("elementdatafile", "")
    stored = _integers(fields, "compresseddatasize", path) if packed else []
    return (
        fields.get("elementtype", ""), channels[0], columns, rows, others[-1] if others else 1,
        big_endian, packed, None if file.upper() == "LOCAL" else file,
        stored[0] if stored else None,
    )  # fmt: skip


def _nrrd(fields: Mapping[str, str], path: Path, sizes: list[int]) -> _Found:
    kinds = [kind.lower() for kind in fields.get("kinds", "").split()]
    if fields.get("dimension", "") != str(len(sizes)) or (kinds and len(kinds) != len(sizes)):
        raise InputError(
            f"{path}: dimension is {fields.get('dimension', '')[:60]!r}, with {len(sizes)} sizes "
            f"and {len(kinds)} kinds; expected the same number"
        )
    axes = list(zip(kinds or [""] * len(sizes), sizes, strict=True))
    channels = axes.pop(0)[1] if axes[0][0] in _COLOUR_KINDS else 1
    count = axes.pop()[1] if axes and axes[-1][0] in _LIST_KINDS else None
    if count is None and len(axes) > 2 and (not kinds or axes[-1][0] in ("???", "none")):
        count = axes.pop()[1]
    if len(axes) not in (2, 3):
        raise InputError(
            f"{path}: sizes are {sizes} of kinds {' '.join(kinds)[:60] or '(none)'}; expected "
            "columns and rows, then images"
        )
    _check_depth(axes[2][1] if len(axes) == 3 else 1, path)
    for key in ("byte skip", "byteskip", "line skip", "lineskip"):
        if fields.get(key, "0") != "0":
            raise InputError(f"{path}: {key} is {fields[key][:60]!r}; expected 0")
    encoding = fields.get("encoding", "").lower()
    if encoding not in ("raw", "gz", "gzip"):
        raise InputError(f"{path}: encoding is {encoding[:60]!r}; expected raw or gzip")
    file = fields.get("data file", fields.get("datafile"))
    return (
        fields.get("type", ""), channels, axes[0][1], axes[1][1], count or 1,
        fields.get("endian", "little").lower() == "big", encoding != "raw", file, None,
    )  # fmt: skip


def _check_depth(depth: int, path: Path) -> None:
    if depth != 1:
        raise InputError(f"{path}: each image has {depth} slices; expected 1: volumes are not read")


def _integers(fields: Mapping[str, str], key: str, path: Path) -> list[int]:
    words = fields.get(key, "").split()
    if not all(word.isascii() and word.isdigit() and len(word) < 16 for word in words):
        raise InputError(f"{path}: {key} is {fields[key][:60]!r}; expected integers")
    return [int(word) for word in words]


def _boolean(fields: Mapping[str, str], key: str, path: Path, *, default: bool) -> bool:
    text = fields.get(key, str(default)).lower()
    if text not in ("true", "false"):
        raise InputError(f"{path}: {key} is {text[:60]!r}; expected True or False")
    return text == "true"


def as_pixels(content: bytes, layout: ImageLayout) -> np.ndarray[Any, np.dtype[np.integer[Any]]]:
    """The pixels of one image as stored: (rows, columns) or (rows, columns, 3), native order."""
    shape = (layout.rows, layout.columns, 3)[: 3 if layout.channels == 3 else 2]
    values = np.frombuffer(content, layout.dtype).reshape(shape)
    return values.astype(values.dtype.newbyteorder("="), copy=False)
