"""The coverage of a calibration as values of the page."""

import math
from typing import Any

from app.workflow import Coverage

_RADIUS = 50.0
_MAX_POINTS = 120


def calibration_map(coverage: Coverage) -> dict[str, Any]:
    """Points and sectors of a plot with +y upwards, 50 units to each side."""
    points = coverage.points_deg[:: max(1, -(-len(coverage.points_deg) // _MAX_POINTS))]
    count = len(coverage.sectors)
    return {
        "points": [
            [round(min(max(x, -_RADIUS), _RADIUS), 1), round(-min(max(y, -_RADIUS), _RADIUS), 1)]
            for x, y in points.tolist()
        ],
        "sectors": [
            {"d": _sector_path(number, count), "covered": is_covered}
            for number, is_covered in enumerate(coverage.sectors)
        ],
    }


def _sector_path(number: int, count: int) -> str:
    ends = [2.0 * math.pi * each / count for each in (number, number + 1)]
    (x0, y0), (x1, y1) = ((_RADIUS * math.cos(a), -_RADIUS * math.sin(a)) for a in ends)
    return f"M0 0L{x0:.2f} {y0:.2f}A{_RADIUS:g} {_RADIUS:g} 0 0 0 {x1:.2f} {y1:.2f}Z"
