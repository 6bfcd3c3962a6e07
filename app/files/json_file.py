"""JSON without duplicate names."""

import json
from pathlib import Path
from typing import Any

from app.files.bounded_io import read_bounded
from app.geometry import InputError


def read_json(path: Path, max_bytes: int) -> Any:
    """The values of the file at ``path``. Raises `InputError` if it cannot be read."""
    return parse_json(read_bounded(path, max_bytes), str(path))


def parse_json(content: str | bytes, place: str) -> Any:
    """The values of ``content``; ``place`` is for the message of the `InputError`."""
    try:
        return json.loads(content, object_pairs_hook=_unique_names)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{place} is not JSON: {error}") from error


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse duplicate names: Slicer takes the first of two values, Python the last."""
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ValueError(f"duplicate name among {', '.join(name for name, _ in pairs[:5])}")
    return values
