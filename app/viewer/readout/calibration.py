"""A calibration of the tool as values of the page."""

import math
from typing import Any

from app.runtime import (
    CalibrationKind,
    CalibrationStatus,
    Coverage,
    calibration_count,
    calibration_numbers,
    calibration_title,
    calibration_verdict,
    coverage_text,
)

_RADIUS = 50.0
_MAX_POINTS = 120


def calibration_values(status: CalibrationStatus, *, can_undo: bool) -> dict[str, Any]:
    """Phase, counts, numbers and verdict; ``can_undo``: the tip before can be restored."""
    fit = status.fit
    verdict, advice = calibration_verdict(status)
    return {
        "revision": status.revision,
        "phase": status.phase.value,
        "kind": status.kind.value,
        "title": calibration_title(status),
        "count": calibration_count(status),
        "numbers": calibration_numbers(fit, status.kind),
        "problem": status.problem,
        "verdict": verdict,
        "ok": fit is not None and fit.accepted,
        "advice": advice,
        "ready": status.can_accept,
        "undo": can_undo,
    }


def calibration_map(coverage: Coverage, kind: CalibrationKind) -> dict[str, Any]:
    """Points and sectors of a plot with +y upwards, 50 units to each side, and their text."""
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
        "text": coverage_text(coverage, kind),
    }


def _sector_path(number: int, count: int) -> str:
    ends = [2.0 * math.pi * each / count for each in (number, number + 1)]
    (x0, y0), (x1, y1) = ((_RADIUS * math.cos(a), -_RADIUS * math.sin(a)) for a in ends)
    return f"M0 0L{x0:.2f} {y0:.2f}A{_RADIUS:g} {_RADIUS:g} 0 0 0 {x1:.2f} {y1:.2f}Z"
