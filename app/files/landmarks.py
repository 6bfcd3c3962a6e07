"""Named points from a file: YAML, or the markups of 3D Slicer (``.mrk.json``, ``.fcsv``).

Slicer writes markups in LPS by default. x and y of such a file are negated here, so that points are
in RAS, the axes that Slicer displays.
"""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.files.bounded_io import read_text
from app.files.document import Section
from app.files.json_file import read_json
from app.files.keys import Block, ListOf, Numbers, Text
from app.files.numbers import parse_numbers
from app.geometry import FloatArray, InputError

_MAX_BYTES = 16_000_000
_AXES = {
    "RAS": (1.0, 1.0, 1.0),
    "0": (1.0, 1.0, 1.0),
    "LPS": (-1.0, -1.0, 1.0),
    "1": (-1.0, -1.0, 1.0),
}
_MARKUPS, _FIDUCIALS, _YAML = ".mrk.json", ".fcsv", (".yaml", ".yml")
POINT_ENDINGS = (_MARKUPS, _FIDUCIALS, *_YAML)
"""Endings of the files that can be read."""

_LANDMARK = Block(
    "a landmark", {"name": Text("its name"), "position_mm": Numbers("its position", 3)}
)
_DOCUMENT = Block("named points", {"landmarks": ListOf("the points", _LANDMARK)})
_FIDUCIAL_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label"
_OLD_COLUMNS = "label,x,y,z,sel,vis"
"""Columns of Slicer 3, whose points are in RAS."""


def read_landmarks(path: Path) -> dict[str, FloatArray]:
    """Read positions (3,) in mm by name, in the file's order.

    YAML: ``landmarks: [{name: A, position_mm: [x, y, z]}, ...]``. Markups: the placed points of the
    file's first list. Raises `InputError` for malformed files, for empty and duplicate names, and
    for a file without landmarks.
    """
    return landmarks_by_name(read_points(path), path)


def read_points(path: Path) -> list[tuple[str, FloatArray]]:
    """Read names and positions as `read_landmarks`, but accept empty and duplicate names."""
    name = path.name.lower()
    found: Iterable[tuple[str, Sequence[float]]]
    if name.endswith(_MARKUPS):
        found, axes = _markups(path)
    elif name.endswith(_FIDUCIALS):
        found, axes = _fiducials(path)
    elif name.endswith(_YAML):
        entries = Section.load(path, _DOCUMENT).sections("landmarks")
        found = [(entry.text("name"), entry.numbers("position_mm")) for entry in entries]
        axes = "RAS"
    else:
        raise InputError(f"{path} is not a landmark file; expected {', '.join(POINT_ENDINGS)}")
    if axes not in _AXES:
        raise InputError(f"{path}: the coordinate system is {axes!r}; expected RAS or LPS")
    points = [(label, _position(label, numbers, path) * _AXES[axes]) for label, numbers in found]
    if not points:
        raise InputError(f"{path} holds no landmarks")
    return points


def landmarks_by_name(
    entries: Iterable[tuple[str, Sequence[float] | FloatArray]], path: Path
) -> dict[str, FloatArray]:
    """Return positions by name; raise `InputError` for a duplicate name or an invalid position."""
    landmarks: dict[str, FloatArray] = {}
    for name, position in entries:
        if not name:
            raise InputError(f"{path}: landmark {len(landmarks)} has no name")
        if name in landmarks:
            raise InputError(f"{path}: landmark {name!r} occurs twice")
        landmarks[name] = _position(name, position, path)
    return landmarks


def _position(name: str, numbers: Sequence[float] | FloatArray, path: Path) -> FloatArray:
    point = np.array(numbers, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(
            f"{path}: landmark {name!r} is at {list(numbers)!r}; expected 3 finite numbers"
        )
    return point


def _markups(path: Path) -> tuple[list[tuple[str, list[float]]], str]:
    """Return labels and positions of the file's first list, and its coordinate system."""
    document = read_json(path, _MAX_BYTES)
    try:
        (markup, *_) = document["markups"]
        axes = str(markup.get("coordinateSystem", "LPS"))
        units = markup.get("coordinateUnits", "mm")
        placed = [
            (str(point["label"]), _json_numbers(point["position"]))
            for point in markup["controlPoints"]
            if point.get("positionStatus", "defined") == "defined"
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is not a Slicer markups file: {type(error).__name__} {error}"
        ) from error
    if units != "mm" and units != ["mm"] * 3:
        raise InputError(f"{path}: coordinateUnits is {units!r}; expected mm")
    return placed, axes


def _json_numbers(values: Any) -> list[float]:
    """The numbers of a JSON list. A text, which can be iterated as well, is not a list."""
    if not (isinstance(values, list) and all(type(value) in (int, float) for value in values)):
        raise TypeError(f"position {str(values)[:60]!r}; expected a list of numbers")
    try:
        return [float(value) for value in values]
    except OverflowError as error:
        raise ValueError(f"position {str(values)[:60]} has a number that is too large") from error


def _fiducials(path: Path) -> tuple[list[tuple[str, list[float]]], str]:
    """Return labels and positions in mm of a table of Slicer 3 to 5, and its coordinate system."""
    lines = read_text(path, _MAX_BYTES).splitlines()
    header = {
        key.strip(): value.strip()
        for key, _, value in (line[1:].partition("=") for line in lines if line.startswith("#"))
    }
    axes, columns = header.get("CoordinateSystem"), header.get("columns", "")
    is_old = columns.replace(" ", "").startswith(_OLD_COLUMNS)
    if is_old:
        axes = axes or "RAS"
    elif axes is None or not columns.startswith(_FIDUCIAL_COLUMNS):
        raise InputError(
            f"{path} is not a Slicer fiducial file; expected a CoordinateSystem and the columns "
            f"{_FIDUCIAL_COLUMNS}, or those of Slicer 3, {_OLD_COLUMNS}"
        )
    expected = _OLD_COLUMNS if is_old else _FIDUCIAL_COLUMNS
    label = expected.split(",").index("label")
    rows = [line for line in lines if line.strip() and not line.startswith("#")]
    points = []
    try:
        # Strict, because an unclosed quotation mark would swallow the points that follow.
        for row in csv.reader(rows, strict=True):
            place = f"{path}: the row {','.join(row)[:80]!r}"
            if len(row) < len(expected.split(",")):
                raise InputError(f"{place} is not a point; expected {expected}")
            points.append((row[label], parse_numbers(" ".join(row[1:4]), 3, place)))
    except csv.Error as error:
        raise InputError(f"{path}: row {len(points) + 1} is not a point: {error}") from error
    return points, axes
