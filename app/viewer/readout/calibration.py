"""A calibration of the tool as values of the page."""

import math
from typing import Any

from app.runtime import (
    CalibrationFit,
    CalibrationKind,
    CalibrationStatus,
    Coverage,
    Phase,
)
from app.viewer.readout.guided_verdict import verdict_of

_RADIUS = 50.0
_MAX_POINTS = 120


def calibration_values(status: CalibrationStatus, *, can_undo: bool) -> dict[str, Any]:
    """Phase, counts, numbers and verdict; ``can_undo``: the tip before can be restored."""
    fit, is_idle = status.fit, status.phase is Phase.IDLE
    verdict, advice = _verdict(status)
    return {
        "revision": status.revision,
        "phase": status.phase.value,
        "kind": status.kind.value,
        "title": "" if is_idle else f"{status.kind.value}: {status.phase.value}",
        "count": _count(status),
        "numbers": [] if fit is None else _numbers(fit, status.kind),
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
    covered = sum(coverage.sectors)
    text = f"{covered} of {count} sectors of a turn"
    if kind is CalibrationKind.PIVOT:
        spread_deg = math.degrees(coverage.spread_rad)
        text = f"{covered} of {count} directions, {spread_deg:.0f} degrees"
    return {
        "points": [
            [round(min(max(x, -_RADIUS), _RADIUS), 1), round(-min(max(y, -_RADIUS), _RADIUS), 1)]
            for x, y in points.tolist()
        ],
        "sectors": [
            {"d": _sector_path(number, count), "covered": is_covered}
            for number, is_covered in enumerate(coverage.sectors)
        ],
        "text": text,
    }


def _sector_path(number: int, count: int) -> str:
    ends = [2.0 * math.pi * each / count for each in (number, number + 1)]
    (x0, y0), (x1, y1) = ((_RADIUS * math.cos(a), -_RADIUS * math.sin(a)) for a in ends)
    return f"M0 0L{x0:.2f} {y0:.2f}A{_RADIUS:g} {_RADIUS:g} 0 0 0 {x1:.2f} {y1:.2f}Z"


def _count(status: CalibrationStatus) -> str:
    fit = status.fit
    count = f"{status.samples} pose{'s' * (status.samples != 1)}"
    return count if fit is None or not fit.used else f"{count}, {fit.used} used"


def _numbers(fit: CalibrationFit, kind: CalibrationKind) -> list[str]:
    if fit.tool_from_tip is None or fit.rms is None:
        return []
    dropped = f", {fit.outliers} dropped" if fit.outliers else ""
    turn_deg = math.degrees(fit.turn_rad)
    sigma = "\N{GREEK SMALL LETTER SIGMA}"
    if kind is CalibrationKind.SPIN:
        expected = "" if fit.sigma_rad is None else f"{math.degrees(fit.sigma_rad):.2f}"
        return [
            f"residual {fit.rms:.2f} degrees RMS{dropped}",
            f"{sigma} of the axis {expected} degrees",
            f"turns the axis by {turn_deg:.2f} degrees",
        ]
    expected = "" if fit.sigma_mm is None else f"{fit.sigma_mm:.2f}"
    moves = f"moves the tip by {fit.shift_mm:.2f} mm"
    return [
        f"residual {fit.rms:.2f} mm RMS{dropped}",
        f"{sigma} of the tip {expected} mm",
        f"{moves}, turns its axis by {turn_deg:.2f} degrees" if turn_deg > 0.005 else moves,
    ]


def _verdict(status: CalibrationStatus) -> tuple[str, str]:
    """Whether the poses are good enough, or why not yet; and what to do."""
    fit = status.fit
    if status.phase is Phase.IDLE:
        return "", ""
    if fit is None:
        return ("computing ..." if status.samples else ""), ""
    return verdict_of(fit, status.phase, "Stop, then use it.")
