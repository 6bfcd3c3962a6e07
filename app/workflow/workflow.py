"""The guided recordings, breaches and notes of a session."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.geometry import InputError
from app.runtime.content import SessionContent
from app.runtime.outputs import PassiveOutput, StepTiming, SwitchContent
from app.session import BreachList, BreachLog, StepResult
from app.workflow.guided_recording import DisplayOperator
from app.workflow.robot_registration import RobotRegistration
from app.workflow.tool_calibration import ToolCalibration

if TYPE_CHECKING:
    from app.runtime.opening import PreparedCase


class Workflow:
    """The guided recordings of a session with ``content``, for all operators of a display.

    ``calibration`` is that of the tools, ``registration`` that of the robot, None without one.
    ``changed()`` is called in any thread when there is something to show.
    """

    def __init__(
        self, content: SessionContent, operator: DisplayOperator, changed: Callable[[], None]
    ) -> None:
        self.calibration = ToolCalibration(content, operator, changed)
        self.registration = (
            None if content.robot is None else RobotRegistration(content, operator, changed)
        )
        guides = (self.calibration, self.registration)
        self._guides = tuple(each for each in guides if each is not None)

    def observe(self, step: StepResult) -> None:
        """Record the poses of ``step``, in the session's thread; every one while `is_recording`."""
        for each in self._guides:
            each.observe(step)

    @property
    def is_recording(self) -> bool:
        """True while poses are recorded, which needs every step."""
        return any(each.is_recording for each in self._guides)

    @property
    def revision(self) -> object:
        """A value that changes when there is something to show without a new step."""
        return tuple(each.revision for each in self._guides)

    def update(self, content: SessionContent) -> None:
        """Follow the session, whose content is now ``content``; in the display's thread."""
        for each in self._guides:
            each.update(content)

    def close(self) -> None:
        """End the threads of the fits."""
        for each in self._guides:
            each.close()


class WorkflowOutput(PassiveOutput):
    """`Output` of a session with ``content``: a display may leave out steps, this leaves out none.

    ``guided`` are its guided recordings.
    """

    def __init__(self, content: SessionContent, guided: Workflow) -> None:
        self.guided = guided
        self._content = content
        self.begin_ns: int | None = None
        """Stamp of the first step; None before it."""
        self._breach_log = _log_of(content)

    @property
    def breaches(self) -> BreachList:
        """The breaches up to the last step."""
        return self._breach_log.breaches

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Record the poses of ``step``, and whether the tool is in the tumour."""
        self.observe(step, self._content)
        return True

    def observe(self, step: StepResult, content: SessionContent) -> None:
        """Record ``step`` like `publish`; it was taken with ``content``."""
        self._use(content)
        if self.begin_ns is None:
            self.begin_ns = step.frame.stamp.ns
        self.guided.observe(step)
        self._breach_log.observe(step)

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Nothing is slow here."""
        return self._use

    def _use(self, content: SessionContent) -> None:
        self._content = content
        self._breach_log.use(
            content.tumor, content.margins.stale_after_ns, content.structure_surfaces
        )


def _log_of(content: SessionContent) -> BreachLog:
    return BreachLog(content.tumor, content.margins.stale_after_ns, content.structure_surfaces)


def recorded_breaches(prepared: "PreparedCase") -> BreachList:
    """Step through all of ``prepared``, which takes seconds, and list its breaches.

    Only before the case is played: a replay uses the same proximity engine.
    """
    from app.runtime.replay_run import ReplayRun

    content = prepared.content
    log = _log_of(content)
    for step in ReplayRun(prepared, clock_ns=lambda: 0).steps():
        log.observe(step)
    return log.breaches


MAX_NOTES = 500
MAX_NOTE_CHARS = 200


@dataclass(frozen=True, slots=True)
class EventNote:
    """Note ``number`` on the step ``frame``, whose stamp is ``stamp_ns`` on the tracker's clock.

    ``begin_s``: time since the first step.
    """

    number: int
    frame: int
    stamp_ns: int
    begin_s: float
    text: str

    @property
    def line(self) -> str:
        """One line for a report."""
        return f"event at {self.begin_s:.2f} s (frame {self.frame}): {self.text}"


class EventNotes:
    """The notes of a session. The page's thread adds; other threads may read `entries`."""

    def __init__(self) -> None:
        self.entries: tuple[EventNote, ...] = ()

    def add(self, frame: int, stamp_ns: int, begin_s: float, text: str) -> EventNote:
        """Add a note. Raises `InputError` for an empty or long text, and above `MAX_NOTES`."""
        line = " ".join(text.split())
        line = "".join(each if each.isprintable() else "?" for each in line)
        if not line or len(line) > MAX_NOTE_CHARS:
            raise InputError(f"note: {len(line)} characters; expected 1 to {MAX_NOTE_CHARS}")
        if len(self.entries) >= MAX_NOTES:
            raise InputError(f"notes: {len(self.entries)}; expected at most {MAX_NOTES}")
        note = EventNote(len(self.entries) + 1, frame, stamp_ns, begin_s, line)
        self.entries = (*self.entries, note)
        return note
