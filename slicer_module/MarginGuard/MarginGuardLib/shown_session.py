"""One session at a time in the scene: what runs, what was shown last, how old that is."""

from collections.abc import Callable

from slicer import vtkMRMLApplicationLogic, vtkMRMLScene, vtkMRMLTransformNode

from app.bridge.control import SessionChanges
from app.bridge.publishing.replay_scene import ReplayScene
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S, InputError
from app.runtime import SessionContent
from app.scene import TransformHealth

from .display import NOTHING_YET, SessionDisplay
from .jobs import one_line
from .replay_steps import OpenedCase, ReplaySteps
from .run import Delivered, Run, Steps


class ShownSession:
    """A live session or a replay, shown in ``mrml_scene``; for the scene's thread alone.

    ``opacity`` and ``patient_to_ras`` are those of every display to come.
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
        self.run: Run | None = None
        self.display: SessionDisplay | None = None
        self.opened: OpenedCase | None = None
        self.health: tuple[TransformHealth, ...] = ()
        self.failure = ""
        self._mrml_scene = mrml_scene
        self._logic = logic
        self._clock_ns = clock_ns
        self._last: Delivered | None = None
        self._content: tuple[ReplayScene, SessionContent] | None = None

    def begin(self, steps: Steps, opened: OpenedCase | None = None) -> None:
        """End what there is, and run ``steps``, of the case ``opened`` when they are a replay."""
        self.end()
        self.opened = opened
        self.run = Run(steps, self._clock_ns)

    def end(self) -> None:
        """Stop the run, and take the display out of the scene."""
        if self.run is not None:
            self.run.stop()
        if self.display is not None:
            self.display.clear()
        self.run = self.opened = self._last = self.display = None
        self.health = ()
        self.failure = ""

    def seek(self, seconds: float, *, paused: bool) -> None:
        """Replay the case from there, as it was changed since it was opened."""
        case, changes = self.case(), self.changes()
        if not 0.0 <= seconds <= case.duration_s:
            raise InputError(f"seek to {seconds:g} s: 0 to {case.duration_s:.1f} s wanted")
        if self.run is not None:
            self.run.stop()
        steps = ReplaySteps(
            case, changes.setup, changes.scene, start_s=seconds, rate=self.rate, paused=paused
        )
        self.run = Run(steps, self._clock_ns)

    def take(self, wait_s: float) -> None:
        """Show the newest step, waited for at most ``wait_s``, and grey what has become old.

        What cannot be brought up to date, as when the user has deleted a node, is taken out of the
        scene: ``failure`` says why, and the next step shows all of it anew.
        """
        if self.run is None:
            return
        delivered = self.run.newest(wait_s)
        try:
            self._show(self.run, delivered)
        except Exception as error:  # whatever it is, nothing may stay as it was
            self.failure = one_line(error)
            display, self.display, self.health = self.display, None, ()
            if display is not None:
                display.clear()

    def _show(self, run: Run, delivered: Delivered | None) -> None:
        changes = run.steps.changes
        if delivered is not None and changes is not None:
            content = self._content_of(changes)
            if self.display is None:
                self.display = SessionDisplay(
                    self._mrml_scene,
                    content,
                    opacity=self.opacity,
                    patient_to_ras=self.patient_to_ras,
                    logic=self._logic,
                )
            elif self._last is None or self._last.run is not run:
                self.display.restart()
            self._last = delivered
            self.health = self.display.show(delivered.step, content, run.present_ns(delivered))
            self.failure = ""
        elif self._last is not None and self.display is not None:
            self.health = self.display.check(run.present_ns(self._last))

    def _content_of(self, changes: SessionChanges) -> SessionContent:
        """The content that ``changes`` holds now, the same object until it is changed."""
        scene = changes.scene
        if self._content is None or self._content[0] is not scene:
            setup = changes.setup
            content = SessionContent(
                name="",
                tumor=scene.tumor,
                tool=scene.tool,
                tip_frame=setup.tool_from_tip.source,
                static_edges=setup.static_edges,
                margins=scene.margins,
                robot=setup.robot,
            )
            self._content = scene, content
        return self._content[1]

    def rearm(self) -> None:
        """End the hold of an earlier fault, for an operator who sees what is shown now.

        Refused while that is UNKNOWN, and when a fault or another tumour, tool, registration or
        margin came after it: nobody can have looked at them.
        """
        run, shown, changes = self.running(), self._last, self.changes()
        if shown is None or self.display is None or self.readout()[0] is MarginState.UNKNOWN:
            raise InputError("the margin that is shown is UNKNOWN: its cause must end first")
        seq = shown.step.decision.seq
        with run.steps.between_steps() as session:
            is_newest = self._content is not None and self._content[0] is changes.scene
            if shown.run is not run or not is_newest:
                raise InputError("what was changed is not shown yet: look at the margin again")
            if seq < run.fault_seq:
                raise InputError(
                    f"a fault came after step {seq}, which is shown: look at the margin again"
                )
            session.rearm()

    @property
    def is_running(self) -> bool:
        """Whether steps may come."""
        return self.run is not None and not self.run.is_over

    @property
    def is_playing(self) -> bool:
        """Whether a replay goes on by itself."""
        return self.is_running and self.opened is not None and not self.replay().player.paused

    @property
    def position_s(self) -> float | None:
        """Seconds from the first frame of the case to the frame that was shown last."""
        if self.opened is None or self._last is None:
            return None
        return (self._last.step.frame.stamp.ns - self.opened.first_ns) / NS_PER_S

    def readout(self) -> tuple[MarginState, str]:
        """The state and the banner, as the scene shows them."""
        if self.display is None:
            why = f"UNKNOWN: nothing is shown, {self.failure}" if self.failure else NOTHING_YET
            return MarginState.UNKNOWN, why
        return self.display.readout()

    def reasons(self) -> str:
        """Those of the last decision, or the one for which it is not shown any more."""
        if self._last is None or self.display is None:
            return ""
        decision = self._last.step.decision
        if self.readout()[0] is not decision.state:
            return str(Reason.STALE)
        return ", ".join(map(str, decision.reasons))

    def text(self) -> str:
        """What the session is, and what it does."""
        if self.run is None:
            return "no session"
        if self.opened is not None:
            manifest = self.opened.case.manifest
            does = "playing" if self.is_playing else "paused" if self.is_running else "ended"
            return f"{manifest.name} ({manifest.provenance.kind}): {does}"
        if not self.is_running:
            return "live session has ended"
        return "connecting ..." if self._last is None else "live"

    def running(self) -> Run:
        """The run; `InputError` when none takes steps."""
        if self.run is None or self.run.is_over:
            raise InputError("there is no session: connect or load a case first")
        return self.run

    def changes(self) -> SessionChanges:
        """What changes the session; `InputError` before it has begun."""
        changes = None if self.run is None else self.run.steps.changes
        if changes is None:
            raise InputError("there is no session: connect or load a case first")
        return changes

    def case(self) -> OpenedCase:
        """The case that is replayed; `InputError` without one."""
        if self.opened is None:
            raise InputError("no case is loaded: load one first")
        return self.opened

    def replay(self) -> ReplaySteps:
        """The replay; `InputError` when the session is none."""
        steps = None if self.run is None else self.run.steps
        if not isinstance(steps, ReplaySteps):
            raise InputError("no case is loaded: load one first")
        return steps

    def shown(self) -> SessionDisplay:
        """The display; `InputError` before there is one."""
        if self.display is None:
            raise InputError("nothing is shown yet: connect or load a case first")
        return self.display
