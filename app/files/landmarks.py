"""Points with names from a file: YAML, or the markups of 3D Slicer (``.mrk.json``, ``.fcsv``).

Slicer writes markups in LPS unless told otherwise: the x and y of such a file are turned around
here, so that points are in RAS axes like everything that Slicer shows.
"""

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.files.bounded_io import read_bounded
from app.files.document import Section
from app.files.numbers import numbers_in
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
"""Files that points are read from."""

_FIDUCIAL_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label"


def read_landmarks(path: Path) -> dict[str, FloatArray]:
    """Name to position (3,) in mm, in the file's order.

    YAML: ``landmarks: [{name: A, position_mm: [x, y, z]}, ...]``. Markups: the first list of the
    file, its points that are placed. Raises `InputError` for anything malformed, for names that
    are empty or stand twice, and for a file without any landmark.
    """
    return checked_landmarks(read_points(path), path)


def read_points(path: Path) -> list[tuple[str, FloatArray]]:
    """As `read_landmarks`, but their names do not matter: they may be empty and stand twice."""
    name = path.name.lower()
    found: Iterable[tuple[str, Sequence[float]]]
    if name.endswith(_MARKUPS):
        found, axes = _markups(path)
    elif name.endswith(_FIDUCIALS):
        found, axes = _fiducials(path)
    elif name.endswith(_YAML):
        entries = Section.load(path, ("landmarks",)).sections("landmarks", ("name", "position_mm"))
        found = [(entry.text("name"), entry.numbers("position_mm", 3)) for entry in entries]
        axes = "RAS"
    else:
        raise InputError(f"{path} is no landmark file: {', '.join(POINT_ENDINGS)} allowed")
    if axes not in _AXES:
        raise InputError(f"{path}: its coordinate system is {axes!r}: RAS or LPS wanted")
    points = [(label, _position(label, numbers, path) * _AXES[axes]) for label, numbers in found]
    if not points:
        raise InputError(f"{path} holds no landmark")
    return points


def checked_landmarks(
    entries: Iterable[tuple[str, Sequence[float] | FloatArray]], path: Path
) -> dict[str, FloatArray]:
    """Names and positions as a mapping; `InputError` for doubles and positions that are none."""
    landmarks: dict[str, FloatArray] = {}
    for name, position in entries:
        if not name:
            raise InputError(f"{path}: landmark {len(landmarks)} has no name")
        if name in landmarks:
            raise InputError(f"{path}: landmark {name!r} stands twice")
        landmarks[name] = _position(name, position, path)
    return landmarks


def _position(name: str, numbers: Sequence[float] | FloatArray, path: Path) -> FloatArray:
    point = np.array(numbers, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(
            f"{path}: landmark {name!r} is at {list(numbers)!r}: 3 finite numbers wanted"
        )
    return point


def _markups(path: Path) -> tuple[list[tuple[str, list[float]]], str]:
    """Labels with positions of the first list of the file, and its coordinate system."""
    document = _json(path)
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
            f"{path} is no Slicer markups file: {type(error).__name__} {error}"
        ) from error
    if units != "mm" and units != ["mm"] * 3:
        raise InputError(f"{path}: coordinateUnits is {units!r}: mm wanted")
    return placed, axes


def _json_numbers(values: Any) -> list[float]:
    """As JSON has them; a text, whose letters could be walked through as well, is no list."""
    if not (isinstance(values, list) and all(type(value) in (int, float) for value in values)):
        raise TypeError(f"position {str(values)[:60]!r}: a list of numbers wanted")
    try:
        return [float(value) for value in values]
    except OverflowError as error:
        raise ValueError(f"position {str(values)[:60]}: numbers that are too large") from error


def _fiducials(path: Path) -> tuple[list[tuple[str, list[float]]], str]:
    """Labels with positions in mm of a table as Slicer 4 wrote it, and its coordinate system."""
    try:
        lines = read_bounded(path, _MAX_BYTES).decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: byte {error.start}") from error
    told = {
        key.strip(): value.strip()
        for key, _, value in (line[1:].partition("=") for line in lines if line.startswith("#"))
    }
    axes, columns = told.get("CoordinateSystem"), told.get("columns", "")
    if axes is None or not columns.startswith(_FIDUCIAL_COLUMNS):
        raise InputError(
            f"{path} is no Slicer fiducial file: a CoordinateSystem and the columns "
            f"{_FIDUCIAL_COLUMNS} wanted"
        )
    rows = [line for line in lines if line.strip() and not line.startswith("#")]
    points = []
    try:
        # Strictly: a quotation mark that is not closed would take the points that follow for text.
        for row in csv.reader(rows, strict=True):
            place = f"{path}: the row {','.join(row)[:80]!r}"
            if len(row) < len(_FIDUCIAL_COLUMNS.split(",")):
                raise InputError(f"{place} is no point: {_FIDUCIAL_COLUMNS} wanted")
            points.append((row[11], numbers_in(" ".join(row[1:4]), 3, place)))
    except csv.Error as error:
        raise InputError(f"{path}: row {len(points) + 1} is no point: {error}") from error
    return points, axes


def _json(path: Path) -> Any:
    try:
        return json.loads(read_bounded(path, _MAX_BYTES), object_pairs_hook=_without_doubles)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}") from error


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Slicer takes the first of two values with one name, Python the last: nobody's guess here."""
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ValueError(f"a name stands twice among {', '.join(name for name, _ in pairs[:5])}")
    return values
