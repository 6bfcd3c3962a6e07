"""One session at a time in the scene: its run, its display, the age of what is displayed."""

import time
from collections.abc import Callable

from slicer import vtkMRMLApplicationLogic, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S, InputError
from app.runtime import (
    DeliveredStep,
    OperatorCommands,
    PreparedCase,
    ReplayRun,
    StepRun,
    StepThread,
)
from app.scene import TransformHealth

from .display import NOTHING_YET, SessionDisplay
from .jobs import one_line


class ShownSession:
    """A live session or a replay, shown in ``mrml_scene``. For the scene's thread only.

    ``opacity`` and ``patient_to_ras`` apply to every later display.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        logic: vtkMRMLApplicationLogic | None,
        clock_ns: Callable[[], int],
    ) -> None:
        self.opacity = 0.4
        self.patient_to_ras: vtkMRMLTransformNode | None = None
        self.rate = 1.0
        self.thread: StepThread | None = None
        self.display: SessionDisplay | None = None
        self.opened: PreparedCase | None = None
        self.health: tuple[TransformHealth, ...] = ()
        self.failure = ""
        self._mrml_scene = mrml_scene
        self._logic = logic
        self._clock_ns = clock_ns
        self._last: DeliveredStep | None = None

    def begin(self, run: StepRun, opened: PreparedCase | None = None) -> None:
        """End the present run and start ``run``, of the case ``opened`` when it is a replay."""
        self.end()
        self.opened = opened
        self._start(run)

    def begin_replay(self, opened: PreparedCase) -> None:
        """Replay ``opened``, paused at its first frame."""
        run = ReplayRun(opened, clock_ns=time.monotonic_ns, rate=self.rate, paused=True)
        self.begin(run, opened)

    def end(self) -> None:
        """Stop the run, and remove the display from the scene."""
        if self.thread is not None:
            self.thread.stop()
        if self.display is not None:
            self.display.clear()
        self.thread = self.opened = self._last = self.display = None
        self.health = ()
        self.failure = ""

    def seek(self, seconds: float, *, paused: bool) -> None:
        """Replay the case from ``seconds``, with the changes since it was opened."""
        case, commands = self.case(), self.commands()
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
            )
        )

    def take(self, wait_s: float) -> None:
        """Show the newest step, waiting at most ``wait_s`` for one, and grey out stale data.

        If the display cannot be updated, as when the user has deleted a node, it is removed from
        the scene, ``failure`` has the reason, and the next step creates it again.
        """
        if self.thread is None:
            return
        delivered = self.thread.newest(wait_s)
        try:
            self._show(self.thread, delivered)
        except Exception as error:  # any error: nothing may stay as it was
            self.failure = one_line(error)
            display, self.display, self.health = self.display, None, ()
            if display is not None:
                display.clear()

    def _start(self, run: StepRun) -> None:
        self.thread = StepThread(run, self._clock_ns, one_line)

    def _show(self, thread: StepThread, delivered: DeliveredStep | None) -> None:
        if delivered is not None and delivered.content is not None:
            if self.display is None:
                self.display = SessionDisplay(
                    self._mrml_scene,
                    delivered.content,
                    opacity=self.opacity,
                    patient_to_ras=self.patient_to_ras,
                    logic=self._logic,
                )
            elif self._last is None or self._last.thread is not thread:
                self.display.restart()
            self._last = delivered
            self.health = self.display.show(
                delivered.step, delivered.content, thread.present_ns(delivered)
            )
            self.failure = ""
        elif self._last is not None and self.display is not None:
            self.health = self.display.check(thread.present_ns(self._last))

    def rearm(self) -> None:
        """End the hold of an earlier fault, on behalf of an operator who sees the display.

        Refused while the displayed state is UNKNOWN, and after a fault or another tumour, tool,
        registration or margin that is not displayed yet: the operator cannot have seen it.
        """
        thread, shown, commands = self.running(), self._last, self.commands()
        if shown is None or self.display is None or self.readout()[0] is MarginState.UNKNOWN:
            raise InputError("the displayed margin is UNKNOWN: its cause must end first")
        seq, displayed = shown.step.decision.seq, self.display.content

        def check() -> None:
            if shown.thread is not thread or displayed is not commands.content:
                raise InputError("the last change is not displayed yet: look at the margin again")
            if seq < thread.fault_seq:
                raise InputError(
                    f"a fault came after the displayed step {seq}: look at the margin again"
                )

        commands.rearm(check)

    @property
    def is_running(self) -> bool:
        """True while steps may follow."""
        return self.thread is not None and not self.thread.is_over

    @property
    def is_playing(self) -> bool:
        """True while a replay plays."""
        return self.is_running and self.opened is not None and not self.replay().player.paused

    @property
    def position_s(self) -> float | None:
        """Time of the displayed frame from the first one of the case, in s."""
        if self.opened is None or self._last is None:
            return None
        return (self._last.step.frame.stamp.ns - self.opened.extent.first_ns) / NS_PER_S

    def readout(self) -> tuple[MarginState, str]:
        """State and banner as the scene shows them."""
        if self.display is None:
            why = f"UNKNOWN: nothing is displayed, {self.failure}" if self.failure else NOTHING_YET
            return MarginState.UNKNOWN, why
        return self.display.readout()

    def reasons(self) -> str:
        """Reasons of the last decision, or the reason why it is not displayed any more."""
        if self._last is None or self.display is None:
            return ""
        decision = self._last.step.decision
        if self.readout()[0] is not decision.state:
            return str(Reason.STALE)
        return ", ".join(map(str, decision.reasons))

    def text(self) -> str:
        """Name and activity of the session."""
        if self.thread is None:
            return "no session"
        if self.opened is not None:
            manifest = self.opened.case.manifest
            does = "playing" if self.is_playing else "paused" if self.is_running else "ended"
            return f"{manifest.name} ({manifest.provenance.kind}): {does}"
        if not self.is_running:
            return "live session has ended"
        return "connecting ..." if self._last is None else "live"

    def running(self) -> StepThread:
        """The thread of the run; `InputError` when none takes steps."""
        if self.thread is None or self.thread.is_over:
            raise InputError("there is no session: connect or load a case first")
        return self.thread

    def commands(self) -> OperatorCommands:
        """The commands of the session; `InputError` before it has started."""
        commands = None if self.thread is None else self.thread.run.commands
        if commands is None:
            raise InputError("there is no session: connect or load a case first")
        return commands

    def case(self) -> PreparedCase:
        """The case that is replayed; `InputError` without one."""
        if self.opened is None:
            raise InputError("no case is loaded: load one first")
        return self.opened

    def replay(self) -> ReplayRun:
        """The replay; `InputError` when the session is none."""
        run = None if self.thread is None else self.thread.run
        if not isinstance(run, ReplayRun):
            raise InputError("no case is loaded: load one first")
        return run

    def shown(self) -> SessionDisplay:
        """The display; `InputError` before there is one."""
        if self.display is None:
            raise InputError("nothing is shown yet: connect or load a case first")
        return self.display
