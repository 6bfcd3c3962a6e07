"""Landmarks of a phantom from a file: YAML, or the markups of 3D Slicer (``.mrk.json``).

Slicer writes markups in LPS unless told otherwise: the x and y of such a file are turned around
here, so that landmarks are in RAS axes like everything that Slicer shows.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.case.document import Section
from app.case.small_file import read_small
from app.geometry import FloatArray, InputError

_MAX_BYTES = 16_000_000
_AXES = {
    "RAS": (1.0, 1.0, 1.0),
    "0": (1.0, 1.0, 1.0),
    "LPS": (-1.0, -1.0, 1.0),
    "1": (-1.0, -1.0, 1.0),
}
_MARKUPS = ".mrk.json"


def read_landmarks(path: Path) -> dict[str, FloatArray]:
    """Name to position (3,) in mm, in the file's order.

    YAML: ``landmarks: [{name: A, position_mm: [x, y, z]}, ...]``. Markups: the first list of the
    file, its points that are placed. Raises `InputError` for anything malformed, for names that
    are empty or stand twice, and for a file without any landmark.
    """
    if path.name.lower().endswith(_MARKUPS):
        return _from_markups(path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path} is no landmark file: .yaml, .yml, {_MARKUPS} allowed")
    entries = Section.load(path, ("landmarks",)).sections("landmarks", ("name", "position_mm"))
    found = [(entry.text("name"), entry.numbers("position_mm", 3)) for entry in entries]
    return _some(checked_landmarks(found, path), path)


def checked_landmarks(
    entries: Iterable[tuple[str, Sequence[float]]], path: Path
) -> dict[str, FloatArray]:
    """Names and positions as a mapping; `InputError` for doubles and positions that are none."""
    landmarks: dict[str, FloatArray] = {}
    for name, position in entries:
        if not name:
            raise InputError(f"{path}: landmark {len(landmarks)} has no name")
        if name in landmarks:
            raise InputError(f"{path}: landmark {name!r} stands twice")
        point = np.array(position, dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise InputError(
                f"{path}: landmark {name!r} is at {list(position)!r}: 3 finite numbers wanted"
            )
        landmarks[name] = point
    return landmarks


def _from_markups(path: Path) -> dict[str, FloatArray]:
    document = _json(path)
    try:
        (markup, *_) = document["markups"]
        axes = str(markup.get("coordinateSystem", "LPS"))
        units = markup.get("coordinateUnits", "mm")
        placed = [
            (str(point["label"]), [float(value) for value in point["position"]])
            for point in markup["controlPoints"]
            if point.get("positionStatus", "defined") == "defined"
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is no Slicer markups file: {type(error).__name__} {error}"
        ) from error
    if axes not in _AXES:
        raise InputError(f"{path}: coordinateSystem is {axes!r}: RAS or LPS wanted")
    if units != "mm" and units != ["mm"] * 3:
        raise InputError(f"{path}: coordinateUnits is {units!r}: mm wanted")
    found = checked_landmarks(placed, path)
    return _some({name: point * _AXES[axes] for name, point in found.items()}, path)


def _json(path: Path) -> Any:
    try:
        return json.loads(read_small(path, _MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}") from error


def _some(landmarks: Mapping[str, FloatArray], path: Path) -> dict[str, FloatArray]:
    if not landmarks:
        raise InputError(f"{path} holds no landmark")
    return dict(landmarks)
