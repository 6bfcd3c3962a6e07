"""Reads volumes of integers from NRRD files, as 3D Slicer writes label maps and segmentations.

Sizes are checked before memory is allocated, and compressed data are not unpacked beyond their
declared size. pynrrd parses the header. Its axes, LPS in files of Slicer, are converted to RAS.
"""

import bz2
import gzip
import math
import re
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import nrrd
import numpy as np
from numpy.typing import NDArray

from app.files.bounded_io import open_for_reading
from app.geometry import FloatArray, InputError

MAX_VOXELS = 1 << 27
"""Values of a file in all its layers: 512 x 512 x 512."""

MAX_DATA_BYTES = 1 << 28
"""Unpacked data of a file: 512 x 512 x 512 values of two bytes."""

_MAX_HEADER_BYTES = 4_000_000
_HEADER_END = re.compile(rb"\r?\n\r?\n")
_MIN_SIDE_MM, _MAX_SIDE_MM = 0.01, 100.0
"""Limits of the sides of a voxel; a side of 1 mm that is given in metres measures 0.001."""

_MIN_UNIT_VOLUME = 1e-3
"""Minimum volume of the box of three unit directions; 1 where they are orthogonal."""

_RAS_SIGNS = {
    "right-anterior-superior": (1.0, 1.0, 1.0),
    "ras": (1.0, 1.0, 1.0),
    "left-anterior-superior": (-1.0, 1.0, 1.0),
    "las": (-1.0, 1.0, 1.0),
    "left-posterior-superior": (-1.0, -1.0, 1.0),
    "lps": (-1.0, -1.0, 1.0),
}
_INTEGERS = {
    name: code
    for code, names in {
        "i1": ("signed char", "int8", "int8_t"),
        "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
        "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
        "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
        "i4": ("int", "signed int", "int32", "int32_t"),
        "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
        "i8": (
            "longlong", "long long", "long long int", "signed long long", "signed long long int",
            "int64", "int64_t",
        ),
        "u8": (
            "ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t",
        ),
    }.items()
    for name in names
}  # fmt: skip
"""Types of integers by the names that the format defines."""

_BYTE_ORDERS = {"little": "<", "big": ">"}
_EXTERNAL_DATA_FIELDS = ("data file", "datafile", "line skip", "lineskip", "byte skip", "byteskip")


@dataclass(frozen=True, slots=True, eq=False)
class NrrdVolume:
    """The values of one file.

    ``layers`` (n, i, j, k): integers, read-only; n is 1 for a volume of three axes.
    ``ras_from_index`` (3, 4): maps an index (i, j, k) to the centre of its voxel in mm.
    ``fields``: the header's fields and its key/value pairs, as text.
    """

    layers: NDArray[np.integer[Any]]
    ras_from_index: FloatArray
    fields: Mapping[str, str]


def read_nrrd(path: Path) -> NrrdVolume:
    """Read the ``.nrrd`` file at ``path``: three spatial axes, or a list of such volumes.

    The axis of a list has the direction ``none``. Raises `InputError` for other content: axes
    other than RAS, LAS and LPS, directions in one plane, values that are not integers, data in
    another file, too few or too many data.
    """
    with open_for_reading(path) as file:
        header = _header(file, path)
        shape = _shape(header, path)
        ras_from_index, list_axis = _geometry(header, path)
        kind = _kind(header, path)
        content = _content(file, header, path, math.prod(shape) * kind.itemsize)
    if len(content) != math.prod(shape) * kind.itemsize:
        raise InputError(
            f"{path}: its data do not fit its header: they have {len(content)} bytes or more; "
            f"expected {math.prod(shape) * kind.itemsize}"
        )
    values = np.frombuffer(content, kind).reshape(shape, order="F")
    layers = values[None] if list_axis is None else np.moveaxis(values, list_axis, 0)
    layers.flags.writeable = False
    fields = {name: value for name, value in header.items() if isinstance(value, str)}
    return NrrdVolume(layers, ras_from_index, fields)


def _header(file: IO[bytes], path: Path) -> dict[str, Any]:
    """Parse the header and leave ``file`` at the first byte of the data."""
    start = file.read(_MAX_HEADER_BYTES)
    end = _HEADER_END.search(start)
    if not start.startswith(b"NRRD") or end is None:
        raise InputError(f"{path} is not an NRRD file; expected a header that begins with NRRD")
    file.seek(end.end())
    try:
        lines = start[: end.start()].decode("utf-8").split("\n")
        with warnings.catch_warnings(action="ignore"):  # of fields that occur twice
            header = dict(nrrd.read_header(lines))
    except Exception as error:  # pynrrd's parsers raise many kinds of errors
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path} has no readable NRRD header: {reason}") from error
    for name in _EXTERNAL_DATA_FIELDS:
        if header.get(name, 0) != 0:
            raise InputError(
                f"{path}: {name!r} is {str(header[name])!r}; expected data right after the "
                "header, in the same file"
            )
    return header


def _shape(header: Mapping[str, Any], path: Path) -> list[int]:
    sizes = np.asarray(_field(header, "sizes", path), dtype=np.float64)
    if not np.isfinite(sizes).all() or sizes.ndim != 1:
        raise InputError(f"{path}: sizes are {sizes.tolist()}; expected integers")
    shape = [int(size) for size in sizes]
    if len(shape) != _field(header, "dimension", path) or len(shape) not in (3, 4):
        raise InputError(
            f"{path}: dimension is {header['dimension']} and sizes are {shape}; expected 3, or 4 "
            "with layers"
        )
    if min(shape) < 1 or math.prod(shape) > MAX_VOXELS:
        raise InputError(f"{path}: sizes are {shape}; expected 1 to {MAX_VOXELS} values")
    return shape


def _geometry(header: Mapping[str, Any], path: Path) -> tuple[FloatArray, int | None]:
    """``ras_from_index`` (3, 4), and the index of the axis of layers, None without one."""
    space = str(_field(header, "space", path))
    if space.lower() not in _RAS_SIGNS:
        raise InputError(f"{path}: space is {space!r}; expected {', '.join(list(_RAS_SIGNS)[::2])}")
    for unit in header.get("space units", ()):
        if unit.lower() not in ("", "mm", "millimeter", "millimeters"):
            raise InputError(f"{path}: space units are {unit!r}; expected mm")
    dimension = int(header["dimension"])
    try:
        directions = np.asarray(_field(header, "space directions", path), dtype=np.float64)
        origin = np.asarray(_field(header, "space origin", path), dtype=np.float64)
    except (ValueError, TypeError) as error:  # vectors of different lengths
        raise InputError(f"{path}: its space directions and origin are no vectors") from error
    list_axis = None
    if directions.shape == (4, 3):
        lists = np.flatnonzero(np.isnan(directions).all(axis=1))
        if len(lists) != 1:
            raise InputError(f"{path}: {len(lists)} of its 4 axes are lists; expected one")
        list_axis = int(lists[0])
        directions = np.delete(directions, list_axis, axis=0)
    if dimension != 3 + (list_axis is not None) or directions.shape != (3, 3):
        raise InputError(
            f"{path}: space directions have shape {directions.shape}; expected a vector per axis"
        )
    with np.errstate(over="ignore"):
        sides = np.linalg.norm(directions, axis=1)
    if origin.shape != (3,) or not np.isfinite(origin).all() or not np.isfinite(sides).all():
        raise InputError(
            f"{path}: space origin is {origin.tolist()}, space directions are "
            f"{directions.tolist()}; expected finite numbers"
        )
    if sides.min() < _MIN_SIDE_MM or sides.max() > _MAX_SIDE_MM:
        raise InputError(
            f"{path}: its voxels measure {' x '.join(f'{side:.6g}' for side in sides)} mm; "
            f"expected {_MIN_SIDE_MM:g} to {_MAX_SIDE_MM:g} mm"
        )
    if abs(np.linalg.det(directions / sides[:, None])) < _MIN_UNIT_VOLUME:
        raise InputError(f"{path}: space directions {directions.tolist()} lie in one plane")
    signs = np.array(_RAS_SIGNS[space.lower()])
    return np.column_stack([directions.T, origin]) * signs[:, None], list_axis


def _kind(header: Mapping[str, Any], path: Path) -> np.dtype[np.integer[Any]]:
    """The type of the values, with its byte order."""
    name = str(_field(header, "type", path))
    code = _INTEGERS.get(name)
    if code is None:
        raise InputError(f"{path}: type is {name!r}; expected integers")
    if code.endswith("1"):
        return np.dtype(code)
    order = str(_field(header, "endian", path))
    if order not in _BYTE_ORDERS:
        raise InputError(f"{path}: endian is {order!r}; expected {' or '.join(_BYTE_ORDERS)}")
    return np.dtype(_BYTE_ORDERS[order] + code)


def _content(file: IO[bytes], header: Mapping[str, Any], path: Path, size: int) -> bytes:
    """The unpacked data; at most one byte more than ``size``."""
    encoding = str(_field(header, "encoding", path)).lower()
    if size > MAX_DATA_BYTES:
        raise InputError(f"{path}: its data have {size} bytes; expected {MAX_DATA_BYTES} or less")
    max_bytes = size + 1
    try:
        if encoding == "raw":
            return file.read(max_bytes)
        if encoding in ("gzip", "gz"):
            with gzip.GzipFile(fileobj=file) as unpacked:
                return unpacked.read(max_bytes)
        if encoding in ("bzip2", "bz2"):
            with bz2.BZ2File(file) as unpacked_bz2:
                return unpacked_bz2.read(max_bytes)
    except (EOFError, zlib.error, OSError) as error:  # OSError: data that are not compressed
        raise InputError(f"{path}: its data are cut or damaged: {error}") from error
    raise InputError(f"{path}: encoding is {encoding!r}; expected raw, gzip or bzip2")


def _field(header: Mapping[str, Any], name: str, path: Path) -> Any:
    if name not in header:
        raise InputError(f"{path}: the field {name!r} is missing")
    return header[name]
