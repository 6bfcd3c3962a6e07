"""A guided calibration or registration in words, the same on the page and in the panel."""

import math
from dataclasses import dataclass

from app.runtime.tracked_tool import GUARDED_TOOL
from app.workflow.calibration_fit import CalibrationFit, CalibrationKind, Coverage
from app.workflow.guided_recording import Phase
from app.workflow.registration_fit import RegistrationFit
from app.workflow.robot_registration import RobotRegistration
from app.workflow.tool_calibration import ToolCalibration


@dataclass(frozen=True, slots=True)
class TouchedPoint:
    """A point of a registration. Its errors are in mm, empty where they are not known."""

    number: int
    id: str
    """Identifies it in `RobotRegistration.remove`; text, as JavaScript's numbers have 53 bits."""
    residual: str
    left_out: str
    problem: str


@dataclass(frozen=True, slots=True)
class GuidedShown:
    """A guided recording as displays show it.

    ``problem``: why nothing is recorded. ``ok``: the result is good enough. ``coverage`` and
    ``numbers``: of a calibration; ``points``: of a registration. A command names ``revision``.
    """

    revision: int = 0
    phase: str = ""
    title: str = ""
    count: str = ""
    coverage: str = ""
    numbers: tuple[str, ...] = ()
    points: tuple[TouchedPoint, ...] = ()
    problem: str = ""
    verdict: str = ""
    advice: str = ""
    ok: bool = False
    can_use: bool = False
    can_undo: bool = False
    can_restore: bool = False

    @property
    def can_start(self) -> bool:
        """True where there is a session for it."""
        return bool(self.phase)

    @property
    def can_discard(self) -> bool:
        """True while there is a recording."""
        return self.phase not in ("", Phase.IDLE)

    @property
    def is_recording(self) -> bool:
        """True while poses are recorded."""
        return self.phase == Phase.RECORDING

    @property
    def text(self) -> str:
        """All of it, one line each; empty before a recording."""
        if not self.can_discard:
            return ""
        lines = [self.title, self.count, self.coverage, *self.numbers]
        lines += [f"point {each.number}: {each.problem}" for each in self.points if each.problem]
        return "\n".join(each for each in [*lines, self.problem, self.verdict, self.advice] if each)


def calibration_shown(guide: ToolCalibration) -> GuidedShown:
    """The calibration now."""
    status = guide.status()
    fit, is_idle = status.fit, status.phase is Phase.IDLE
    verdict, advice = _verdict(fit, status.phase, "Stop, then use it.")
    if fit is None and status.samples and not is_idle:
        verdict = "computing ..."
    of = "" if status.tool == GUARDED_TOOL else f" of the {status.tool}"
    count = f"{status.samples} pose{'s' * (status.samples != 1)}"
    return GuidedShown(
        revision=status.revision,
        phase=status.phase.value,
        title="" if is_idle else f"{status.kind}{of}: {status.phase}",
        count=count if fit is None or not fit.used else f"{count}, {fit.used} used",
        coverage="" if fit is None else _coverage(fit.coverage, status.kind),
        numbers=() if fit is None else _numbers(fit, status.kind),
        problem=f"No pose is recorded: {status.problem}" if status.problem else "",
        verdict=verdict,
        advice=advice,
        ok=fit is not None and fit.accepted,
        can_use=status.can_accept,
        can_undo=guide.can_undo,
    )


def registration_shown(guide: RobotRegistration) -> GuidedShown:
    """The registration now."""
    status = guide.status()
    fit = status.fit
    verdict, advice = _verdict(fit, status.phase, "Touch more points, or stop and use it.")
    points = tuple(
        TouchedPoint(
            number,
            str(each.interval[0]),
            _mm(each.residual_mm),
            _mm(each.leave_one_out_mm),
            each.problem,
        )
        for number, each in enumerate(() if fit is None else fit.points, start=1)
    )
    by = "" if status.tool == GUARDED_TOOL else f" with the {status.tool}"
    count = f"{status.phase}, {len(points)} point{'s' * (len(points) != 1)}{by}"
    return GuidedShown(
        revision=status.revision,
        phase=status.phase.value,
        count="" if status.phase is Phase.IDLE else count,
        points=points,
        problem=f"Nothing is recorded: {status.problem}" if status.problem else "",
        verdict=verdict,
        advice=advice,
        ok=fit is not None and fit.accepted,
        can_use=status.can_accept,
        can_undo=guide.can_undo,
        can_restore=status.can_restore,
    )


def _verdict(
    fit: CalibrationFit | RegistrationFit | None, phase: Phase, when_enough: str
) -> tuple[str, str]:
    """Whether ``fit`` is good enough, and what to do: ``when_enough`` if so while recording."""
    if fit is None or phase is Phase.IDLE:
        return "", ""
    advice = f"{fit.advice[:1].upper()}{fit.advice[1:]}." if fit.advice else ""
    if fit.accepted:
        return f"Good enough: {fit.reason}", when_enough if phase is Phase.RECORDING else ""
    return f"{'Not yet' if phase is Phase.RECORDING else 'Not accepted'}: {fit.reason}", advice


def _numbers(fit: CalibrationFit, kind: CalibrationKind) -> tuple[str, ...]:
    """Residual, expected error and difference from the tip in use; empty without a result."""
    if fit.tool_from_tip is None or fit.rms is None:
        return ()
    dropped = f", {fit.outliers} dropped" if fit.outliers else ""
    turn_deg = math.degrees(fit.turn_rad)
    sigma = "\N{GREEK SMALL LETTER SIGMA}"
    if kind is CalibrationKind.SPIN:
        expected = "" if fit.sigma_rad is None else f"{math.degrees(fit.sigma_rad):.2f}"
        return (
            f"residual {fit.rms:.2f} degrees RMS{dropped}",
            f"{sigma} of the axis {expected} degrees",
            f"turns the axis by {turn_deg:.2f} degrees",
        )
    moves = f"moves the tip by {fit.shift_mm:.2f} mm"
    return (
        f"residual {fit.rms:.2f} mm RMS{dropped}",
        f"{sigma} of the tip {_mm(fit.sigma_mm)} mm",
        f"{moves}, turns its axis by {turn_deg:.2f} degrees" if turn_deg > 0.005 else moves,
    )


def _coverage(coverage: Coverage, kind: CalibrationKind) -> str:
    """The number of covered sectors; for a pivot also the spread of the directions."""
    count, covered = len(coverage.sectors), sum(coverage.sectors)
    if kind is CalibrationKind.PIVOT:
        spread_deg = math.degrees(coverage.spread_rad)
        return f"{covered} of {count} directions, {spread_deg:.0f} degrees"
    return f"{covered} of {count} sectors of a turn"


def _mm(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
