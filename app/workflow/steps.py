"""The steps of a case, from connection to review: what each needs, has, and why it is not done.

Pure: page and panel show the same steps of the same session. No step blocks another one; a session
decides by its own rules, which these texts only repeat.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

from app.fixture import MarginState
from app.geometry import SurfaceMesh
from app.runtime.case_recorder import RecordingStatus
from app.runtime.content import SessionContent
from app.session import REFERENCE, StepResult
from app.workflow.calibration_fit import NO_TIP_MM
from app.workflow.guided_recording import Phase
from app.workflow.tool_calibration import CalibrationStatus

_MM3_PER_CM3 = 1000.0


class WorkflowName(StrEnum):
    """The steps, in their order."""

    CONNECT = "connect"
    CALIBRATE = "calibrate"
    CONTOUR = "contour"
    REGISTER = "register"
    NAVIGATE = "navigate"
    REVIEW = "review"


class WorkflowState(StrEnum):
    """Whether a step is done."""

    DONE = "done"
    OPEN = "not done"
    ABSENT = "not needed"


_SYMBOLS = {WorkflowState.DONE: "\u2713", WorkflowState.OPEN: "\u2715", WorkflowState.ABSENT: "-"}


@dataclass(frozen=True, slots=True)
class WorkflowStep:
    """One step. ``problem`` is why it is not done, empty if it is done or not needed."""

    name: WorkflowName
    needs: str
    has: str
    problem: str = ""
    is_needed: bool = True

    @property
    def state(self) -> WorkflowState:
        """Whether it is done."""
        if not self.is_needed:
            return WorkflowState.ABSENT
        return WorkflowState.OPEN if self.problem else WorkflowState.DONE

    @property
    def symbol(self) -> str:
        """A symbol of `state`."""
        return _SYMBOLS[self.state]

    @property
    def line(self) -> str:
        """One line for a display."""
        text = ": ".join(part for part in (self.has, self.problem) if part)
        return f"{self.symbol} {self.name}: {text or 'nothing'}"


def workflow_steps(
    step: StepResult | None,
    content: SessionContent,
    *,
    is_live: bool,
    silent: str = "",
    has_images: bool = False,
    calibration: CalibrationStatus | None = None,
    recording: RecordingStatus | None = None,
) -> tuple[WorkflowStep, ...]:
    """The six steps of a session that uses ``content``, after ``step``; None before the first.

    ``silent``: why ``step`` is outdated, empty while it is not. ``has_images``: the tumour can be
    contoured in images; that of a live session's configuration is then not yet a contour.
    ``calibration`` and ``recording`` are those of a live session, None where there are none.
    """
    return (
        _connect(step, content, silent),
        _calibrate(content, calibration),
        _contour(content, is_expected=is_live and has_images),
        _register(content),
        _navigate(step, silent),
        _review(recording, is_live=is_live),
    )


def next_step(steps: Sequence[WorkflowStep]) -> WorkflowStep | None:
    """The first step that is not done; None if all are."""
    return next((each for each in steps if each.state is WorkflowState.OPEN), None)


def _connect(step: StepResult | None, content: SessionContent, silent: str) -> WorkflowStep:
    required = required_frames(content)
    needs = f"poses of {', '.join(required)}"
    if step is None or silent:
        return WorkflowStep(
            WorkflowName.CONNECT, needs, "no present poses", silent or "no step has come yet"
        )
    usable = {
        name for edge, sample in step.edges.measured.items() if sample is not None for name in edge
    }
    missing = [name for name in required if name not in usable]
    has = f"{len(required) - len(missing)} of {len(required)} tracked frames"
    return WorkflowStep(
        WorkflowName.CONNECT,
        needs,
        has,
        f"no usable pose of {', '.join(missing)} now" if missing else "",
    )


def _calibrate(content: SessionContent, calibration: CalibrationStatus | None) -> WorkflowStep:
    tip = content.tool_from_tip
    length_mm = float(np.linalg.norm(tip.translation_mm))
    has = f"tip {length_mm:.1f} mm from the sensor"
    has += (
        f", sigma {content.tip_sigma_mm:.2f} mm"
        if content.tip_sigma_mm > 0.0
        else ", uncertainty not known"
    )
    problem = ""
    if length_mm < NO_TIP_MM and not tip.target.lower().endswith("tip"):
        problem = "the tip is at the sensor's origin, as if it was never calibrated"
    if calibration is not None and calibration.phase is not Phase.IDLE:
        is_stopped = calibration.phase is Phase.STOPPED
        result = "its result is not used yet" if is_stopped else "is being recorded"
        what = f"a {calibration.kind} of the {calibration.tool}"
        problem = f"{what}{':' if is_stopped else ''} {result}"
    return WorkflowStep(WorkflowName.CALIBRATE, f"the tip of {tip.target}", has, problem)


def _contour(content: SessionContent, *, is_expected: bool) -> WorkflowStep:
    volume = _volume_mm3(content.tumor) / _MM3_PER_CM3
    sigma = content.tumor_sigma_mm
    stated = f"sigma {sigma:.2f} mm" if sigma > 0.0 else "uncertainty not known"
    origin = "accepted in this session" if content.tumor_accepted else "given with the case"
    has = f"tumour of {volume:.2f} cm\u00b3, {stated}, {origin}"
    is_open = is_expected and not content.tumor_accepted
    problem = "no contour was accepted in this session" if is_open else ""
    return WorkflowStep(WorkflowName.CONTOUR, "a closed surface of the tumour", has, problem)


@lru_cache(maxsize=2)  # of a large surface it takes milliseconds
def _volume_mm3(surface: SurfaceMesh) -> float:
    return surface.signed_volume_mm3


def _register(content: SessionContent) -> WorkflowStep:
    robot, result = content.robot, content.registration
    if robot is None:
        return WorkflowStep(WorkflowName.REGISTER, "nothing", "no robot", is_needed=False)
    needs = f"an accepted registration of {robot.base_frame}"
    if result is None:
        return WorkflowStep(WorkflowName.REGISTER, needs, "none", "the robot is not registered")
    points = f"{len(result.used)} points" if len(result.used) else "given"
    has = points if result.fre_mm is None else f"{points}, FRE {result.fre_mm:.2f} mm"
    problem = "" if result.accepted else f"not accepted, {result.reason}"
    return WorkflowStep(WorkflowName.REGISTER, needs, has, problem)


def _navigate(step: StepResult | None, silent: str) -> WorkflowStep:
    needs = "a known margin, and no hold"
    if step is None or silent:
        return WorkflowStep(WorkflowName.NAVIGATE, needs, "no margin", silent or "no step yet")
    decision = step.decision
    has = decision.state.display.label
    if decision.state is MarginState.UNKNOWN:
        problem = ", ".join(reason.text for reason in decision.reasons) or "not known"
    elif decision.hold:
        causes = "; ".join(step.hold_causes) or "no cause was noted"
        problem = f"on hold until re-armed: {causes}"
    else:
        problem = ""
    return WorkflowStep(WorkflowName.NAVIGATE, needs, has, problem)


def _review(recording: RecordingStatus | None, *, is_live: bool) -> WorkflowStep:
    needs = "a finished recording"
    if not is_live:
        return WorkflowStep(WorkflowName.REVIEW, needs, "the recording that is shown")
    if recording is None:
        return WorkflowStep(WorkflowName.REVIEW, needs, "none", "nothing is recorded")
    has = f"{recording.folder.name}, {recording.duration_s:.0f} s"
    problem = "it is being recorded" if recording.active else recording.problem
    return WorkflowStep(WorkflowName.REVIEW, needs, has, problem)


def required_frames(content: SessionContent) -> list[str]:
    """The tracked frames that a session with ``content`` needs."""
    frames = [content.tool_from_tip.target, content.frame_from_tumor.target]
    return frames if content.robot is None else [*frames, REFERENCE]
