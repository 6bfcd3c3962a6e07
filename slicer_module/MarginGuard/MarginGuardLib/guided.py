"""Guided calibration and registration of the shown session, as the panel's user edits them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.geometry import InputError
from app.registration import RegistrationResult
from app.runtime import (
    CalibrationKind,
    CalibrationStatus,
    Coverage,
    GuidedFits,
    Operator,
    Phase,
    RegistrationStatus,
    RobotRegistration,
    SessionContent,
    SetRegistration,
    TipChange,
    TrackedTool,
    WorkflowOutput,
    calibration_count,
    calibration_numbers,
    calibration_title,
    calibration_verdict,
    coverage_text,
    fit_calibration,
    fit_registration,
    registration_count,
    registration_verdict,
    tip_command,
)

from .jobs import Jobs


@dataclass(frozen=True, slots=True)
class GuidedShown:
    """A guided recording as the panel shows it.

    ``text``: counts, numbers, verdict and advice, one line each. ``coverage``: of a calibration.
    ``rows``: of a registration, for each point its number, residual and error when left out.
    """

    text: str = ""
    coverage: Coverage | None = None
    rows: tuple[tuple[str, str, str], ...] = ()
    can_start: bool = False
    is_recording: bool = False
    can_discard: bool = False
    can_use: bool = False
    can_undo: bool = False
    can_restore: bool = False


class _Guided:
    """One guided recording; ``use`` requests that the session uses a result.

    Call it in the scene's thread. A command applies to what the last `update` has shown, and raises
    `InputError` with why not.
    """

    def __init__(self, guide: Any, fits: GuidedFits[Any, Any], use: Callable[[Any], bool]) -> None:
        self._guide = guide
        self._fits = fits
        self._use = use
        self._seen = 0

    def update(self, content: SessionContent) -> None:
        """Use the session's present content, take a fit that is done, and begin the next one."""
        self._guide.use_content(content)
        self._fits.follow()
        self._seen = self._guide.status().revision

    def stop(self) -> None:
        """End the recording."""
        self._guide.stop(self._seen)

    def discard(self) -> None:
        """Drop the recording."""
        self._guide.discard(self._seen)

    def use(self) -> None:
        """Use the result in the session, which is then on hold."""
        self._guide.accept(self._seen, self._use)

    def undo(self) -> None:
        """Use what the session used before."""
        self._guide.undo(self._seen, self._use)

    def close(self) -> None:
        """End the thread of the fits."""
        self._fits.close()


class GuidedCalibration(_Guided):
    """Pivot and spin of a tool."""

    def start(self, kind: CalibrationKind, tool: TrackedTool = TrackedTool.CAUTERY) -> None:
        """Begin to record poses of ``tool``; drops what was recorded before."""
        self._guide.start(self._seen, kind, tool)

    @property
    def status(self) -> CalibrationStatus:
        """The calibration now."""
        status: CalibrationStatus = self._guide.status()
        return status

    def shown(self) -> GuidedShown:
        """What the panel shows of it."""
        status, lines = self.status, []
        fit, is_idle = status.fit, status.phase is Phase.IDLE
        if not is_idle:
            lines = [calibration_title(status), calibration_count(status)]
            lines += [] if fit is None else [coverage_text(fit.coverage, status.kind)]
            lines += calibration_numbers(fit, status.kind)
            lines += [f"No pose is recorded: {status.problem}"] if status.problem else []
            lines += [each for each in calibration_verdict(status) if each]
        return GuidedShown(
            text="\n".join(lines),
            coverage=None if fit is None else fit.coverage,
            can_start=True,
            is_recording=status.phase is Phase.RECORDING,
            can_discard=not is_idle,
            can_use=status.can_accept,
            can_undo=self._guide.can_undo,
        )


class GuidedRegistration(_Guided):
    """Registration of the robot by touch."""

    def start(self, tool: TrackedTool = TrackedTool.CAUTERY) -> None:
        """Begin to detect the points at which ``tool`` rests; drops those before."""
        self._guide.start(self._seen, tool)

    def remove(self, row: int) -> None:
        """Remove the point in ``row``, counted from 0."""
        fit = self._guide.status().fit
        points = () if fit is None else fit.points
        if not 0 <= row < len(points):
            raise InputError("registration: no point is selected; expected a row of the table")
        self._guide.remove(self._seen, points[row].interval[0])

    def restore(self) -> None:
        """Use the point again that was removed last."""
        self._guide.restore(self._seen)

    def shown(self) -> GuidedShown:
        """What the panel shows of it."""
        status: RegistrationStatus = self._guide.status()
        fit, lines = status.fit, [registration_count(status)]
        points = () if fit is None else fit.points
        lines += [f"point {n}: {each.problem}" for n, each in enumerate(points, 1) if each.problem]
        lines += [f"Nothing is recorded: {status.problem}"] if status.problem else []
        lines += registration_verdict(status)
        rows = (
            (str(number), _mm(each.residual_mm), _mm(each.leave_one_out_mm))
            for number, each in enumerate(points, 1)
        )
        return GuidedShown(
            text="\n".join(each for each in lines if each),
            rows=tuple(rows),
            can_start=True,
            is_recording=status.phase is Phase.RECORDING,
            can_discard=status.phase is not Phase.IDLE,
            can_use=status.can_accept,
            can_undo=self._guide.can_undo,
            can_restore=status.can_restore,
        )


class GuidedWork:
    """The guided recordings of one session; ``jobs`` make the session use their results."""

    def __init__(
        self,
        workflow: WorkflowOutput,
        operator: Operator,
        jobs: Jobs,
        changed: Callable[[], None],
    ) -> None:
        self.workflow = workflow
        tool, robot = workflow.calibration, workflow.registration
        self.calibration = GuidedCalibration(
            tool,
            GuidedFits[Any, Any](tool, fit_calibration, operator.compute, changed),
            lambda change: _use_tip(operator, jobs, change),
        )
        self.registration = None if robot is None else _registration(robot, operator, jobs, changed)

    def update(self, content: SessionContent) -> None:
        """Follow the session and the fits."""
        for each in self._parts:
            each.update(content)

    def close(self) -> None:
        """End the threads of the fits."""
        for each in self._parts:
            each.close()

    @property
    def _parts(self) -> list[_Guided]:
        parts: list[_Guided | None] = [self.calibration, self.registration]
        return [each for each in parts if each is not None]


def _registration(
    robot: RobotRegistration, operator: Operator, jobs: Jobs, changed: Callable[[], None]
) -> GuidedRegistration:
    fits = GuidedFits[Any, Any](robot, fit_registration, operator.compute, changed)
    return GuidedRegistration(robot, fits, lambda result: _use(operator, jobs, result))


def _use_tip(operator: Operator, jobs: Jobs, change: TipChange) -> bool:
    return _begun(jobs, "using the tip", lambda: operator.request(tip_command(change)))


def _use(operator: Operator, jobs: Jobs, result: RegistrationResult) -> bool:
    command = SetRegistration(result)
    return _begun(jobs, "using the registration", lambda: operator.request(command))


def _begun(jobs: Jobs, name: str, work: Callable[[], object]) -> bool:
    """False while another job runs: it may change the same session."""
    if jobs.current:
        return False
    jobs.submit(name, work, lambda _: None)
    return True


def _mm(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
