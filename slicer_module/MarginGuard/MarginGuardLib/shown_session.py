"""The session in the scene: its run, the step that was shown last, and the age of that step."""

import time
from collections.abc import Callable

from slicer import vtkMRMLApplicationLogic, vtkMRMLScene, vtkMRMLTransformNode

from app.case import ENERGY_DEVICE, Activation
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S, InputError
from app.runtime import (
    DeliveredStep,
    Operator,
    OperatorCommand,
    PreparedCase,
    Rearm,
    ReplayRun,
    SessionContent,
    StepRun,
    StepThread,
)
from app.scene import MarkerStyle, TransformHealth
from app.session import (
    HOLD,
    SHOWN_STATES,
    BreachList,
    ShownState,
    StepResult,
    banner_states,
    margin_display,
    off_line,
    structure_line,
)
from app.workflow import Workflow, WorkflowOutput

from .display import NOT_TRACKED_YET, SessionDisplay
from .jobs import JobOperator, Jobs, one_line
from .live_step_run import LiveStepRun

THE_PANEL = "the panel"
"""Origin of its requests in a replay."""


class ShownSession:
    """A live session or a replay in ``mrml_scene``. Call it in the scene's thread only.

    ``opacity``, ``marker_style``, ``patient_to_ras`` and ``rate`` apply to each later display or
    replay. ``changed()`` is called in another thread when there is a new step.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        logic: vtkMRMLApplicationLogic | None,
        clock_ns: Callable[[], int],
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.opacity = 0.4
        self.marker_style = MarkerStyle()
        self.patient_to_ras: vtkMRMLTransformNode | None = None
        self.requests = Jobs(changed)
        """Requests of a live session, which a node that hangs would keep this thread waiting."""
        self.rate = 1.0
        self.thread: StepThread | None = None
        self.display: SessionDisplay | None = None
        self.opened: PreparedCase | None = None
        self.health: tuple[TransformHealth, ...] = ()
        self.failure = ""
        self._mrml_scene = mrml_scene
        self._logic = logic
        self._clock_ns = clock_ns
        self._changed = changed
        self._last: DeliveredStep | None = None
        self.jobs = Jobs(changed)
        """Slow work of the panel, one after the other."""
        self.display_operator = JobOperator(self.jobs, self.started)
        self._workflow: WorkflowOutput | None = None
        self._recorded = BreachList()

    def begin(self, run: StepRun, opened: PreparedCase | None = None) -> None:
        """End the present run and start ``run``; ``opened`` is the case of a replay."""
        self.end()
        self.opened = opened
        self._start(run)

    def begin_replay(self, opened: PreparedCase, breaches: BreachList) -> None:
        """Replay ``opened`` with its ``breaches``, paused at its first frame."""
        workflow = self.workflow_of(opened.content)
        run = ReplayRun(
            opened,
            clock_ns=time.monotonic_ns,
            rate=self.rate,
            paused=True,
            outputs=(workflow,),
            origin=THE_PANEL,
        )
        self.begin(run, opened)
        self._workflow, self._recorded = workflow, breaches

    def end(self) -> None:
        """Stop the run and remove the display from the scene."""
        if self.workflow is not None:
            self.workflow.guided.close()
        if self.thread is not None:
            self.thread.stop()
        if self.display is not None:
            self.display.clear()
        self.requests.cancel()
        self.thread = self.opened = self._last = self.display = self._workflow = None
        self.health = ()
        self.failure = ""

    def workflow_of(self, content: SessionContent) -> WorkflowOutput:
        """The guided recordings and breaches of a session with ``content``."""
        guided = Workflow(content, self.display_operator, self._changed)
        return WorkflowOutput(content, guided)

    def seek(self, seconds: float, *, paused: bool) -> None:
        """Replay from ``seconds`` with the present setup and content of the session."""
        case, commands = self.case(), self.replay().commands
        duration_s = case.extent.duration_s
        if not 0.0 <= seconds <= duration_s:
            raise InputError(f"seek to {seconds:g} s; expected 0 to {duration_s:.1f} s")
        if self.thread is not None:
            self.thread.stop()
        self._start(
            ReplayRun(
                case,
                clock_ns=time.monotonic_ns,
                rate=self.rate,
                start_s=seconds,
                paused=paused,
                setup=commands.setup,
                content=commands.content,
                outputs=() if self._workflow is None else (self._workflow,),
                origin=THE_PANEL,
            )
        )

    def update(self, wait_s: float) -> None:
        """Wait for the newest step at most ``wait_s`` and show it; show stale data as unknown.

        If the display cannot be updated, for example because the user has deleted a node, it is
        removed from the scene and ``failure`` is the cause. The next step creates it again.
        """
        if self.thread is None:
            return
        delivered = self.thread.newest(wait_s)
        try:
            self._show(self.thread, delivered)
        except Exception as error:  # after any error an outdated display must not remain
            self.failure = one_line(error)
            display, self.display, self.health = self.display, None, ()
            if display is not None:
                display.clear()

    def _start(self, run: StepRun) -> None:
        self.thread = StepThread(run, self._clock_ns, one_line, self._changed)

    def _show(self, thread: StepThread, delivered: DeliveredStep | None) -> None:
        if delivered is not None and delivered.content is not None:
            if self.display is None:
                self.display = SessionDisplay(
                    self._mrml_scene,
                    delivered.content,
                    opacity=self.opacity,
                    marker_style=self.marker_style,
                    patient_to_ras=self.patient_to_ras,
                    logic=self._logic,
                )
            elif self._last is None or self._last.thread is not thread:
                self.display.presenter.restart()
            self._last = delivered
            self.health = self.display.show(
                delivered.step, delivered.content, thread.present_ns(delivered)
            )
            self.failure = ""
        elif self._last is not None and self.display is not None:
            self.health = self.display.presenter.check(thread.present_ns(self._last))

    def rearm(self) -> Rearm:
        """The command that ends the hold which the displayed step shows.

        It is refused if a fault or another tumour, tool, registration or looser margin followed
        that step, because the operator has not seen it. Raises `InputError` while the displayed
        state is UNKNOWN.
        """
        thread, shown = self.running(), self._last
        if shown is None or self.display is None or self.readout()[0] is MarginState.UNKNOWN:
            raise InputError(
                "the displayed margin is UNKNOWN; expected a known state: its cause must end first"
            )
        if shown.thread is not thread or shown.seen is None:
            raise InputError(
                "the last change is not displayed yet; expected a re-arm after it is displayed"
            )
        return Rearm(shown.seen.seq, shown.seen.nonce)

    @property
    def is_running(self) -> bool:
        """True while steps may follow."""
        return self.thread is not None and not self.thread.is_over

    @property
    def is_playing(self) -> bool:
        """True while a replay runs and is not paused."""
        return self.is_running and self.opened is not None and not self.replay().player.paused

    @property
    def present_ns(self) -> int | None:
        """The present on the clock of the stamps; None before the first step."""
        if self.thread is None or self._last is None:
            return None
        return self.thread.present_ns(self._last)

    @property
    def silent(self) -> str:
        """The reason why the shown step is not the present, empty while it is."""
        if self._last is None or self.display is None:
            return NOT_TRACKED_YET
        if self.readout()[0] is self._last.step.decision.state:
            return ""
        known = "" if self.live is None else self.live.silence
        return known or "no step has followed"

    @property
    def live(self) -> LiveStepRun | None:
        """The run of a live session; None in a replay and without a session."""
        run = None if self.thread is None else self.thread.run
        return run if isinstance(run, LiveStepRun) else None

    @property
    def workflow(self) -> WorkflowOutput | None:
        """Guided recordings and breaches of all steps; None before a session has begun."""
        return self._workflow if self.live is None else self.live.workflow

    @property
    def breaches(self) -> BreachList:
        """Those of the recording in a replay, live those so far."""
        workflow = self.workflow
        if self.opened is not None:
            return self._recorded
        return BreachList() if workflow is None else workflow.breaches

    @property
    def shown_step(self) -> StepResult | None:
        """The step that was shown last; None before the first."""
        return None if self._last is None else self._last.step

    @property
    def ready_ns(self) -> int | None:
        """When the step that was shown last was ready, on the session's clock; None before it."""
        return None if self._last is None else self._last.at_ns

    @property
    def position_s(self) -> float | None:
        """Seconds from the first frame of the case to the displayed one; None without one."""
        if self.opened is None or self._last is None:
            return None
        return (self._last.step.frame.stamp.ns - self.opened.extent.first_ns) / NS_PER_S

    def readout(self) -> tuple[MarginState, str]:
        """The state and the banner, as the scene shows them."""
        if self.display is None:
            why = f"UNKNOWN: nothing is shown, {self.failure}" if self.failure else NOT_TRACKED_YET
            return MarginState.UNKNOWN, why
        return self.display.readout()

    def banner(self) -> tuple[ShownState, str]:
        """The worse of margin and latched hold, and a text on both, as on the page."""
        state, text = self.readout()
        decision = None if self._last is None else self._last.step.decision
        is_current = decision is not None and state is decision.state
        margin = margin_display(decision) if is_current else SHOWN_STATES[state.name]
        latched = decision is not None and Reason.LATCHED in decision.reasons
        shown, beside = banner_states(margin, latched=latched)
        if beside is None:
            return shown, text
        held = "HOLD until re-armed"
        return shown, f"{held}; margin {text}" if shown.key == HOLD else f"{text}; {held}"

    def reasons(self) -> str:
        """Reasons of the displayed decision; a line for each cause of its hold, structure and tool.

        Structures that are switched off are listed as such.

        "stale" instead of the reasons and structures when the scene shows it as unknown.
        """
        if self._last is None or self.display is None:
            return ""
        decision = self._last.step.decision
        reasons = ", ".join(map(str, decision.reasons))
        structures = [structure_line(each) for each in self._last.step.structures]
        structures += [each.text for each in self._last.step.tools]
        if self.readout()[0] is not decision.state:
            reasons, structures = str(Reason.STALE), []
        causes = (f"hold: {cause}" for cause in self._last.step.hold_causes)
        off = (off_line(*each) for each in self._last.step.off.items())
        return "\n".join([reasons, *causes, *structures, *off])

    def activation(self) -> str:
        """The activation, unknown while the display is stale; empty if it is not told."""
        told = None if self._last is None else self._last.step.frame.activation
        if told is None or self._last is None:
            return ""
        is_stale = self.readout()[0] is not self._last.step.decision.state
        state = Activation.UNKNOWN if is_stale else told
        return f"{state.symbol} {ENERGY_DEVICE.name} {state.label}"

    def last_request(self) -> str:
        """The last request to change the session, and what became of it."""
        operator = self.operator
        last = None if operator is None else operator.last_request
        return "" if last is None else last.line

    def text(self) -> str:
        """Name and activity of the session."""
        if self.thread is None:
            return "no session"
        if self.opened is not None:
            manifest = self.opened.case.manifest
            activity = "playing" if self.is_playing else "paused" if self.is_running else "ended"
            return f"{manifest.name} ({manifest.provenance.kind}): {activity}"
        if not self.is_running:
            return "live session has ended"
        if self._last is None:
            return "connecting ..."
        playback = self._last.step.playback
        return f"live, PLAYBACK: {playback}" if playback else "live"

    def running(self) -> StepThread:
        """The thread of the run; raises `InputError` if none runs."""
        if self.thread is None or self.thread.is_over:
            raise InputError("there is no session; expected one: connect or load a case first")
        return self.thread

    @property
    def operator(self) -> Operator | None:
        """Access to the session; None before it has started."""
        return None if self.thread is None else self.thread.run.operator

    def request(self, command: OperatorCommand) -> None:
        """Carry ``command`` out in a replay; begin to, live: `requests` then has the outcome.

        Raises `InputError` before the session has started, and in a replay for a refused one.
        """
        operator = self.started()
        if self.opened is not None:
            operator.request(command)
        else:
            # The outcome of an accepted request is in the list of requests.
            kind = str(command.kind)
            self.requests.submit(kind, lambda: operator.request(command), lambda _: None)

    def started(self) -> Operator:
        """`operator`; raises `InputError` before the session has started."""
        operator = self.operator
        if operator is None:
            raise InputError("there is no session; expected one: connect or load a case first")
        return operator

    def case(self) -> PreparedCase:
        """The replayed case; raises `InputError` without one."""
        if self.opened is None:
            raise InputError("no case is loaded; expected one: load a case first")
        return self.opened

    def replay(self) -> ReplayRun:
        """The replay; raises `InputError` if the session is not a replay."""
        run = None if self.thread is None else self.thread.run
        if not isinstance(run, ReplayRun):
            raise InputError("no case is loaded; expected one: load a case first")
        return run

    def shown(self) -> SessionDisplay:
        """The display; raises `InputError` before it exists."""
        if self.display is None:
            raise InputError(
                "nothing is shown yet; expected a session: connect or load a case first"
            )
        return self.display
