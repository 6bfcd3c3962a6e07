"""The list of breaches as values for the page."""

from typing import Any

from app.session import BreachList

_MAX_ROWS = 50
"""Breaches on the page: the deepest one, and the last ones."""


def breach_rows(breaches: BreachList) -> dict[str, Any]:
    """The number of breaches, and of each that is listed its time, depth, place and tool part."""
    deepest = breaches.deepest
    listed = breaches.entries[-_MAX_ROWS:]
    if deepest is not None and deepest not in listed:
        listed = (deepest, *listed[1:])
    return {
        "count": breaches.count,
        "rows": [
            {
                "n": entry.number,
                "frame": entry.deepest,
                "first": entry.first,
                "time": f"{entry.begin_s:.1f} s",
                "depth": f"{entry.depth_mm:.1f} mm",
                "place": entry.place_text,
                "letters": entry.place,
                "part": entry.tool_text,
                "deepest": entry is deepest,
                "open": entry.is_open,
            }
            for entry in listed
        ],
    }
