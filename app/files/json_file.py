"""A JSON file without duplicate names, of limited size."""

import json
from pathlib import Path
from typing import Any

from app.files.bounded_io import read_bounded
from app.geometry import InputError


def read_json(path: Path, max_bytes: int) -> Any:
    """The values of the file at ``path``. Raises `InputError` if it cannot be read."""
    try:
        return json.loads(read_bounded(path, max_bytes), object_pairs_hook=_unique_names)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}") from error


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse duplicate names: Slicer takes the first of two values, Python the last."""
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ValueError(f"duplicate name among {', '.join(name for name, _ in pairs[:5])}")
    return values
