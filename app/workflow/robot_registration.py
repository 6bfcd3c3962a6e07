"""Guided registration of the session's robot: touch points, see residuals, remove, accept, undo."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, FrameError, InputError, Transform
from app.registration import RegistrationResult
from app.runtime.content import SessionContent
from app.runtime.operator_command import SetRegistration
from app.runtime.tracked_tool import GUARDED_TOOL, REFUSED, tip_of
from app.session import REFERENCE, RobotSetup, StepResult
from app.workflow.guided_recording import DisplayOperator, GuidedRecording, Phase
from app.workflow.registration_fit import (
    Interval,
    RegistrationFit,
    RegistrationTask,
    fit_registration,
)
from app.workflow.tool_calibration import MIN_INTERVAL_NS

MAX_SAMPLES = 30_000
"""Samples that are kept: 7 minutes or more."""


class RobotSamples:
    """Samples of steps in which ``tool`` and joints are both known.

    ``problem`` is why the last step gave none, empty if it did.
    """

    def __init__(self, tool: str = GUARDED_TOOL) -> None:
        self.problem = ""
        self._touch = tool
        self._times_ns: list[int] = []
        self._tool: list[Transform] = []
        self._link: list[Transform] = []
        self._reference_from_tumor_frame: Transform | None = None

    def __len__(self) -> int:
        return len(self._times_ns)

    def observe(self, step: StepResult, content: SessionContent, robot: RobotSetup) -> None:
        """Keep the poses of ``step``, if they are new."""
        self.problem = self._keep(step, content, robot)

    def snapshot(self) -> "RobotSamples":
        """The samples so far. 30,000 of them take a millisecond, for which steps wait."""
        copied = RobotSamples(self._touch)
        copied._times_ns = self._times_ns.copy()
        copied._tool, copied._link = self._tool.copy(), self._link.copy()
        copied._reference_from_tumor_frame = self._reference_from_tumor_frame
        return copied

    def task(
        self, run: int, content: SessionContent, robot: RobotSetup, excluded: tuple[Interval, ...]
    ) -> RegistrationTask:
        """The samples so far, to be fitted. 30,000 of them take 0.1 s."""
        targets_mm: FloatArray | None = None
        if self._reference_from_tumor_frame is not None:
            placed = self._reference_from_tumor_frame @ content.frame_from_tumor
            targets_mm = placed.apply(content.tumor.box_corners_mm)
        return RegistrationTask(
            run=run,
            times_ns=tuple(self._times_ns),
            tool_rotations=np.array([each.rotation for each in self._tool]),
            tool_translations_mm=np.array([each.translation_mm for each in self._tool]),
            link_rotations=np.array([each.rotation for each in self._link]),
            link_translations_mm=np.array([each.translation_mm for each in self._link]),
            tool_from_tip=tip_of(content, self._touch),
            base_frame=robot.base_frame,
            tool_link=robot.tool_link,
            excluded=excluded,
            targets_mm=targets_mm,
            tool=self._touch,
        )

    def _keep(self, step: StepResult, content: SessionContent, robot: RobotSetup) -> str:
        refused = REFUSED.intersection(step.decision.reasons)
        if refused:
            return ", ".join(sorted(reason.text for reason in refused))
        try:
            tool, oldest = step.edges.between(REFERENCE, tip_of(content, self._touch).target)
            link, joints = step.edges.between(robot.base_frame, robot.tool_link)
        except FrameError as error:
            return str(error)
        if oldest is None or joints is None:
            return f"the {self._touch} is not tracked, or the robot sends no joints"
        if len(self) >= MAX_SAMPLES:
            return f"{len(self)} samples are recorded, and no more are: stop"
        since_ns = MIN_INTERVAL_NS if not self._times_ns else oldest.ns - self._times_ns[-1]
        if since_ns < 0:
            return "the tracker's clock went back; discard, and begin again"
        if since_ns >= MIN_INTERVAL_NS:
            self._times_ns.append(oldest.ns)
            self._tool.append(tool)
            self._link.append(link)
            try:
                tumor_frame = content.frame_from_tumor.target
                self._reference_from_tumor_frame, _ = step.edges.between(REFERENCE, tumor_frame)
            except FrameError:
                return ""  # the place of the tumour is that of an earlier step
        return ""


_NEW_SAMPLES = 15


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationStatus:
    """A guided registration as it is now.

    ``revision`` counts the changes by operators. ``tool`` touches the points. ``problem``: why no
    sample is recorded, empty while they come. ``fit`` is the newest one of this recording.
    ``can_accept``: it is that of all samples, and accepted. ``can_restore``: a removed point can
    come back.
    """

    revision: int
    tool: str
    phase: Phase
    samples: int
    problem: str
    fit: RegistrationFit | None
    can_accept: bool
    can_restore: bool


class RobotRegistration(GuidedRecording[RegistrationResult]):
    """Detects where the tool on the robot of ``content`` rests, and registers from these points.

    A pointer touches the robot's tip with its own, where the tool on the robot is not tracked.

    `observe` is called with each step, in the session's thread; all other methods in any thread.
    Raises `InputError` for a content without a robot.
    """

    def __init__(
        self, content: SessionContent, operator: DisplayOperator, changed: Callable[[], None]
    ) -> None:
        super().__init__("registration", content, fit_registration, operator, changed)
        if content.robot is None:
            raise InputError("registration: the session has no robot; expected one")
        self._robot = content.robot
        self._tool = GUARDED_TOOL
        self._samples = RobotSamples()
        self._excluded: tuple[Interval, ...] = ()

    def _observe(self, step: StepResult) -> None:
        self._samples.observe(step, self._content, self._robot)

    def status(self) -> RegistrationStatus:
        """The present status, to be shown."""
        with self._lock:
            is_recording = self._phase is Phase.RECORDING
            return RegistrationStatus(
                revision=self._revision,
                tool=self._tool,
                phase=self._phase,
                samples=len(self._samples),
                problem=self._samples.problem if is_recording else "",
                fit=self._fit,
                can_accept=self._refusal() == "",
                can_restore=bool(self._excluded),
            )

    def start(self, seen: int, tool: str = GUARDED_TOOL) -> None:
        """Begin to record where ``tool`` touches; drops the points before.

        Raises `InputError` without the pointer, and for one that is not calibrated.
        """
        with self._lock:
            self._check(seen)
            tip_of(self._content, tool)
            self._tool = tool
            self._begin(Phase.RECORDING)

    def remove(self, seen: int, first_ns: int) -> None:
        """Remove the point that begins at ``first_ns``; the same place may be touched again."""
        with self._lock:
            self._check(seen)
            points = () if self._fit is None else self._fit.points
            found = next((each for each in points if each.interval[0] == first_ns), None)
            if found is None:
                raise InputError("registration: that point does not exist; expected a shown one")
            self._excluded = (*self._excluded, found.interval)
            self._revision += 1

    def restore(self, seen: int) -> None:
        """Use the point again that was removed last."""
        with self._lock:
            self._check(seen)
            if not self._excluded:
                raise InputError("registration: no point was removed; expected one to restore")
            self._excluded = self._excluded[:-1]
            self._revision += 1

    def task(self) -> RegistrationTask | None:
        """The samples to be fitted now; None while the newest fit is that of nearly all."""
        with self._lock:
            if self._phase is Phase.IDLE or not len(self._samples):
                return None
            fit = self._fit
            new = len(self._samples) - (0 if fit is None else fit.samples)
            is_same = fit is not None and fit.excluded == self._excluded
            if is_same and new < (_NEW_SAMPLES if self._phase is Phase.RECORDING else 1):
                return None
            samples = self._samples.snapshot()
            context = self._run, self._content, self._robot, self._excluded
        return samples.task(*context)

    def _command(self, result: RegistrationResult) -> SetRegistration:
        return SetRegistration(result)

    def _replacement(self) -> tuple[RegistrationResult | None, RegistrationResult]:
        if self._fit is None or self._fit.result is None:
            raise InputError("registration: there is no result; expected one")
        return self._content.registration, self._fit.result

    def _is_in_use(self, result: RegistrationResult) -> bool:
        used = self._content.registration  # of another process: equal, not the same object
        return used is not None and result.transform.is_same(used.transform)

    def _refusal(self) -> str:
        """The reason why nothing can be accepted; empty if something can."""
        if self._phase is not Phase.STOPPED:
            return "registration: no recording has been stopped; expected one"
        if not len(self._samples):
            why = self._samples.problem or "the recording was stopped at once"
            return f"registration: nothing was recorded, {why}; expected some points"
        fit = self._fit
        if fit is None or fit.samples < len(self._samples) or fit.excluded != self._excluded:
            return "registration: it is being computed; expected the same request in a moment"
        return "" if fit.accepted else f"registration: {fit.reason}"

    def _clear(self) -> None:
        self._samples = RobotSamples(self._tool)
        self._excluded = ()
