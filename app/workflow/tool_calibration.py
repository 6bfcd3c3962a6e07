"""Guided calibration of a session's tools: record poses, see what is missing, accept, undo."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.geometry import NS_PER_MS, FloatArray, FrameError, InputError, Transform
from app.runtime.content import SessionContent
from app.runtime.operator_command import ITEM_COMMANDS, SetItemTip, SetTip
from app.runtime.tracked_tool import GUARDED_TOOL, REFUSED
from app.session import REFERENCE, StepResult
from app.workflow.calibration_fit import (
    CalibrationFit,
    CalibrationKind,
    CalibrationTask,
    fit_calibration,
)
from app.workflow.guided_recording import DisplayOperator, GuidedRecording, Phase

MAX_POSES = 6000
"""Poses that are kept; a calibration needs some hundred."""

MIN_INTERVAL_NS = 15 * NS_PER_MS
"""Shortest time between two poses that are kept: a tracker of 1 kHz fills no list in seconds."""


class ToolSamples:
    """Poses of ``tool`` in the reference, or in its tracker's frame where there is no reference.

    The session's own rules decide which poses may be used: stale, lost, frozen and implausible ones
    are not among them. ``problem`` is why the last step gave none, empty if it did.
    """

    def __init__(self, tool: str) -> None:
        self.problem = ""
        self.reference = ""
        self._tool = tool
        self._last_ns: int | None = None
        self._rotations: list[FloatArray] = []
        self._translations_mm: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._rotations)

    @property
    def is_full(self) -> bool:
        """True if no more poses are kept."""
        return len(self) >= MAX_POSES

    def observe(self, step: StepResult) -> None:
        """Keep the pose of ``step``, if it is a new one."""
        self.problem = self._keep(step)

    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Copies of the rotations (n, 3, 3) and translations (n, 3) in mm, in order of time."""
        return np.array(self._rotations), np.array(self._translations_mm)

    def _keep(self, step: StepResult) -> str:
        refused = REFUSED.intersection(step.decision.reasons)
        if refused:
            return ", ".join(sorted(reason.text for reason in refused))
        if not self.reference:
            self.reference = self._reference(step)
        if not self.reference:
            return f"{self._tool!r} has not been tracked yet"
        try:
            pose, oldest = step.edges.between(self.reference, self._tool)
        except FrameError as error:
            return str(error)
        if oldest is None:
            return f"{self._tool!r} is not measured in {self.reference!r}"
        since_ns = None if self._last_ns is None else oldest.ns - self._last_ns
        if since_ns is not None and 0 <= since_ns < MIN_INTERVAL_NS:
            return ""
        if not self.is_full:
            self._last_ns = oldest.ns
            self._rotations.append(pose.rotation)
            self._translations_mm.append(pose.translation_mm)
        return ""

    def _reference(self, step: StepResult) -> str:
        measured = step.edges.measured
        if any(REFERENCE in edge for edge in measured):
            return REFERENCE
        return next((target for target, source in measured if source == self._tool), "")


_NEW_POSES = 5
"""Poses after which a fit is computed again."""


@dataclass(frozen=True, slots=True, eq=False)
class TipChange:
    """A tip to be used by the session, with its standard deviation in the worst direction."""

    tool_from_tip: Transform
    sigma_mm: float
    tool: str = GUARDED_TOOL


def tip_command(change: TipChange) -> SetTip | SetItemTip:
    """The command that uses the tip of ``change`` for its tool, and for no other one."""
    tip = change.tool_from_tip, change.sigma_mm
    if change.tool == GUARDED_TOOL:
        return SetTip(*tip)
    command: SetItemTip = ITEM_COMMANDS[change.tool](*tip)
    return command


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationStatus:
    """A calibration as it is now.

    ``revision`` counts the changes by operators. ``samples`` poses of ``tool`` are recorded;
    ``problem``: why no further one is, empty while they come. ``fit`` is the newest one of this
    recording, None before the first. ``can_accept``: the fit is that of all poses, and accepted.
    """

    revision: int
    tool: str
    kind: CalibrationKind
    phase: Phase
    samples: int
    problem: str
    fit: CalibrationFit | None
    can_accept: bool


class ToolCalibration(GuidedRecording[TipChange]):
    """Records poses of a tool of ``content``, one calibration at a time, for all operators.

    The tool is the guarded one or a pointer: an accepted result replaces the tip of this one.

    `observe` is called with each step, in the session's thread; all other methods in any thread.
    """

    def __init__(
        self, content: SessionContent, operator: DisplayOperator, changed: Callable[[], None]
    ) -> None:
        super().__init__("calibration", content, fit_calibration, operator, changed)
        self._tool = GUARDED_TOOL
        self._kind = CalibrationKind.PIVOT
        self._samples = ToolSamples(content.tool_from_tip.target)

    def _observe(self, step: StepResult) -> None:
        self._samples.observe(step)

    def status(self) -> CalibrationStatus:
        """The present status, to be shown."""
        with self._lock:
            problem = self._samples.problem if self._phase is Phase.RECORDING else ""
            if self._samples.is_full and not problem:
                problem = f"{len(self._samples)} poses are recorded, and no more are: stop"
            return CalibrationStatus(
                revision=self._revision,
                tool=self._tool,
                kind=self._kind,
                phase=self._phase,
                samples=len(self._samples),
                problem=problem,
                fit=self._fit,
                can_accept=self._refusal() == "",
            )

    def in_use(self, tool: str) -> TipChange | None:
        """The tip of ``tool`` that the session uses, by the last `use_content`; None without."""
        with self._lock:
            return self._in_use(tool)

    def start(self, seen: int, kind: CalibrationKind, tool: str = GUARDED_TOOL) -> None:
        """Begin to record poses of ``tool``; drops what was recorded before.

        Raises `InputError` for a pointer that the session does not have, and for the spin of a tool
        without a tip: its axis would have no sign.
        """
        with self._lock:
            self._check(seen)
            known = self._known(tool)
            if kind is CalibrationKind.SPIN and not known.translation_mm.any():
                raise InputError(
                    f"spin: the tip of {known.target!r} is at the sensor's origin; expected "
                    "a pivot calibration before"
                )
            self._kind, self._tool = kind, tool
            self._begin(Phase.RECORDING)

    def task(self) -> CalibrationTask | None:
        """The poses to be fitted now; None while the newest fit is that of nearly all."""
        with self._lock:
            known = 0 if self._fit is None else self._fit.samples
            new = len(self._samples) - known
            if self._phase is Phase.IDLE or new < (_NEW_POSES if self.is_recording else 1):
                return None
            rotations, translations_mm = self._samples.arrays()
            return CalibrationTask(
                self._kind,
                self._run,
                self._samples.reference,
                rotations,
                translations_mm,
                self._known(self._tool),
            )

    def _known(self, tool: str) -> Transform:
        """The tip in use; at the sensor's origin for a pointer that is not calibrated."""
        if tool == GUARDED_TOOL:
            return self._content.tool_from_tip
        item = self._content.item(tool)
        return item.frame_from_tip or Transform.identity(item.frame, item.tip_frame)

    def _in_use(self, tool: str) -> TipChange | None:
        content = self._content
        if tool == GUARDED_TOOL:
            return TipChange(content.tool_from_tip, content.tip_sigma_mm)
        item = next((each for each in content.items if each.name == tool), None)
        if item is None or item.frame_from_tip is None:
            return None
        return TipChange(item.frame_from_tip, item.sigma_mm, tool)

    def _command(self, result: TipChange) -> SetTip | SetItemTip:
        return tip_command(result)

    def _replacement(self) -> tuple[TipChange | None, TipChange]:
        fit, before = self._fit, self._in_use(self._tool)
        if fit is None or fit.tool_from_tip is None:
            raise InputError("calibration: there is no result; expected one")
        sigma_mm = fit.sigma_mm
        if sigma_mm is None:
            sigma_mm = 0.0 if before is None else before.sigma_mm
        return before, TipChange(fit.tool_from_tip, sigma_mm, self._tool)

    def _is_in_use(self, result: TipChange) -> bool:
        used = self._in_use(result.tool)
        return used is not None and result.tool_from_tip.is_same(used.tool_from_tip)

    def _refusal(self) -> str:
        """The reason why nothing can be accepted; empty if something can."""
        if self._phase is not Phase.STOPPED:
            return "calibration: no recording has been stopped; expected one"
        if self._fit is None or self._fit.samples < len(self._samples):
            if not len(self._samples):
                why = self._samples.problem or "the recording was stopped at once"
                return f"calibration: no pose was recorded, {why}; expected 10 or more"
            return "calibration: it is being computed; expected the same request in a moment"
        return "" if self._fit.accepted else f"calibration: {self._fit.reason}"

    def _clear(self) -> None:
        self._samples = ToolSamples(self._known(self._tool).target)
