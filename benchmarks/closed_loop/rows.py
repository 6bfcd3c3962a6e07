"""Rows of pushes: read, merged and summarised, so that a long run can be made in parts."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from app.geometry import InputError

STOP_MM = 1.0
"""``stop_mm`` of the shipped live.yaml."""

_KEYS = ("fixture", "number", "lowest_mm", "vertices_mm", "breach_mm", "stops")

Row = Mapping[str, Any]
"""The fields of a `benchmarks.closed_loop.pushes.Push` by name."""


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The rows in the file of an earlier run; empty without the file. Raises `InputError`."""
    if not path.exists():
        return []
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text())["rows"]
        for row in rows:
            for name in _KEYS:
                row[name]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: {error!r}; expected the rows of an earlier run") from error
    return rows


def merged(earlier: Sequence[Row], later: Sequence[Row]) -> list[dict[str, Any]]:
    """Both, ordered; of two rows of one push the later counts."""
    found = {(row["fixture"], row["number"]): dict(row) for row in (*earlier, *later)}
    return [found[key] for key in sorted(found)]


def lines_of(rows: Sequence[Row], fixture: bool) -> list[str]:
    """Lines that summarise the rows of one kind, at least one."""
    lowest = sorted(row["lowest_mm"] for row in rows)
    vertices = [row["vertices_mm"] for row in rows]
    free = [row for row in rows if not row["stops"]]
    driven = sum(row["breach_mm"] is not None for row in rows)
    stops = sum((Counter(row["stops"]) for row in rows), Counter())
    lines = [
        f"{'with' if fixture else 'without'} the fixture: {len(rows)} pushes, lowest true distance "
        f"{lowest[0]:.2f} to {lowest[-1]:.2f} mm, {sum(each < STOP_MM for each in lowest)} below "
        f"{STOP_MM:g} mm, {driven} of them by the tool's own motion; {len(rows) - len(free)} "
        "pushes with a safe stop",
        f"  by libigl at every step: {min(vertices):.2f} to {max(vertices):.2f} mm",
    ]
    if stops:
        causes = ", ".join(f"{cause} {count}" for cause, count in sorted(stops.items()))
        lines.append(f"  safe stops: {causes}")
    if free:
        lines.append(
            "  without a stop: "
            + ", ".join(f"{name} {_range(free, key)} mm/s" for name, key in _SPEEDS.items())
        )
    return lines


_SPEEDS = {"approach": "approach_mm_s", "sliding": "slide_mm_s", "retreat": "retreat_mm_s"}


def _range(rows: Sequence[Row], key: str) -> str:
    values = [row[key] for row in rows]
    return f"{min(values):.0f} to {max(values):.0f}"
