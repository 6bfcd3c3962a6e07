"""A guided calibration or registration in words, the same on the page and in the panel."""

import math
from typing import Protocol

from app.runtime.tracked_tool import TrackedTool
from app.runtime.workflow.calibration_fit import CalibrationFit, CalibrationKind
from app.runtime.workflow.coverage import Coverage
from app.runtime.workflow.guided_recording import Phase
from app.runtime.workflow.robot_registration import RegistrationStatus
from app.runtime.workflow.tool_calibration import CalibrationStatus


class _Fit(Protocol):
    @property
    def accepted(self) -> bool: ...

    @property
    def reason(self) -> str: ...

    @property
    def advice(self) -> str: ...


def calibration_title(status: CalibrationStatus) -> str:
    """What is calibrated and in which phase; empty before a recording."""
    if status.phase is Phase.IDLE:
        return ""
    of = "" if status.tool is TrackedTool.CAUTERY else f" of the {status.tool}"
    return f"{status.kind}{of}: {status.phase}"


def calibration_verdict(status: CalibrationStatus) -> tuple[str, str]:
    """Whether the poses are good enough, or why not yet; and what to do."""
    fit = status.fit
    if status.phase is Phase.IDLE:
        return "", ""
    if fit is None:
        return ("computing ..." if status.samples else ""), ""
    return _verdict(fit, status.phase, "Stop, then use it.")


def calibration_count(status: CalibrationStatus) -> str:
    """How many poses are recorded, and used."""
    fit = status.fit
    count = f"{status.samples} pose{'s' * (status.samples != 1)}"
    return count if fit is None or not fit.used else f"{count}, {fit.used} used"


def calibration_numbers(fit: CalibrationFit | None, kind: CalibrationKind) -> list[str]:
    """Residual, expected error and difference from the tip in use; empty without a result."""
    if fit is None or fit.tool_from_tip is None or fit.rms is None:
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


def coverage_text(coverage: Coverage, kind: CalibrationKind) -> str:
    """How many sectors are covered; for a pivot also the spread of the directions."""
    count, covered = len(coverage.sectors), sum(coverage.sectors)
    if kind is CalibrationKind.PIVOT:
        spread_deg = math.degrees(coverage.spread_rad)
        return f"{covered} of {count} directions, {spread_deg:.0f} degrees"
    return f"{covered} of {count} sectors of a turn"


def registration_verdict(status: RegistrationStatus) -> tuple[str, str]:
    """Whether the points are good enough, or why not yet; and what to do."""
    fit = status.fit
    if status.phase is Phase.IDLE or fit is None:
        return "", ""
    return _verdict(fit, status.phase, "Touch more points, or stop and use it.")


def registration_count(status: RegistrationStatus) -> str:
    """Phase, and how many points were touched; empty before a recording."""
    if status.phase is Phase.IDLE:
        return ""
    count = 0 if status.fit is None else len(status.fit.points)
    by = "" if status.tool is TrackedTool.CAUTERY else f" with the {status.tool}"
    return f"{status.phase}, {count} point{'s' * (count != 1)}{by}"


def _verdict(fit: _Fit, phase: Phase, when_enough: str) -> tuple[str, str]:
    """The verdict on ``fit``, and what to do: ``when_enough`` if it is good while recording."""
    advice = f"{fit.advice[:1].upper()}{fit.advice[1:]}." if fit.advice else ""
    if fit.accepted:
        return f"Good enough: {fit.reason}", when_enough if phase is Phase.RECORDING else ""
    return f"{'Not yet' if phase is Phase.RECORDING else 'Not accepted'}: {fit.reason}", advice
