"""What the panel's buttons do. No Qt, no maths: it joins a session, a display and jobs.

Everything here is for the scene's thread; `GuardLogic.spin` is called by its timer.
"""

import time
from collections.abc import Callable
from pathlib import Path

from slicer import (
    vtkMRMLCameraNode,
    vtkMRMLMarkupsNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.fixture import MarginParameters, MarginState, Reason
from app.geometry import NS_PER_S, InputError
from app.registration import RegistrationResult
from app.scene import Preset, TransformHealth, points_of_markups

from .alarm import Alarm
from .display import NOTHING_YET, SessionDisplay
from .jobs import Jobs
from .live_steps import LiveSteps
from .registering import (
    registration_of_case,
    registration_of_landmarks,
    registration_text,
)
from .replay_steps import OpenedCase, ReplaySteps, open_recorded
from .run import Delivered, Run, Steps
from .status import PanelStatus
from .tumor_input import surface_of

WAIT_S = 0.005
"""How long a spin waits for a step, and lets other threads work meanwhile."""


class GuardLogic:
    """One session at a time, live or replayed, shown in ``mrml_scene``.

    A command that cannot be done raises `MarginGuardError`, with one line for the user; what goes
    wrong later stands in the status.
    """

    def __init__(
        self, mrml_scene: vtkMRMLScene, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.alarm = Alarm()
        self.display: SessionDisplay | None = None
        self.candidate: RegistrationResult | None = None
        self._mrml_scene = mrml_scene
        self._clock_ns = clock_ns
        self._jobs = Jobs()
        self._run: Run | None = None
        self._opened: OpenedCase | None = None
        self._last: Delivered | None = None
        self._health: tuple[TransformHealth, ...] = ()
        self._message = ""
        self._rate = 1.0
        self._opacity = 0.4
        self._patient_to_ras: vtkMRMLTransformNode | None = None
        self._follow: vtkMRMLCameraNode | None = None

    def connect(self, config: Path) -> None:
        """Guard live with this ``live.yaml``; what is wrong with it is said in the status."""
        self._end_session()
        self._begin(LiveSteps(config))

    def disconnect(self) -> None:
        """End the session; what it showed turns grey."""
        if self._run is None:
            raise InputError("nothing is connected")
        self._run.stop()

    def load_case(self, folder: Path) -> None:
        """Open and register a recorded case beside this thread; it then waits at its beginning."""
        if not folder.is_dir():  # an empty line in the panel is no case either
            raise InputError(f"{folder} is no case: no such folder")

        def opened(case: OpenedCase) -> None:
            self._end_session()
            self._opened = case
            self._message = ""
            self._seek(case, 0.0, paused=True)

        self._jobs.begin("opening the case", lambda: open_recorded(folder), opened)

    def play(self) -> None:
        """Go on with the replay; from the beginning when it has ended."""
        replay = self._replay()
        if self._run is not None and self._run.is_over:
            self._seek(self._case(), 0.0, paused=False)
        else:
            replay.player.resume()

    def pause(self) -> None:
        """Hold the replay at the frame that it shows."""
        self._replay().player.pause()

    def step(self) -> None:
        """Show the next frame, and stay paused."""
        self._replay().player.step()

    def seek(self, seconds: float) -> None:
        """Go on from there, with a session of its own; a paused replay stays paused."""
        self._seek(self._case(), seconds, paused=self._replay().player.paused)

    def set_rate(self, rate: float) -> None:
        """Recording seconds a second, for this replay and for the next ones."""
        if self._opened is not None:
            self._replay().set_rate(rate)
        self._rate = rate

    def rearm(self) -> None:
        """End the hold of an earlier fault; `NotRearmableError` while the state is UNKNOWN.

        The state that counts is the one that is shown: nobody can have looked at another.
        """
        state, _ = self._readout()
        if state is MarginState.UNKNOWN:
            raise InputError("the margin that is shown is UNKNOWN: its cause must end first")
        with self._session_run().steps.between_steps() as session:
            session.rearm()

    def margins(self) -> MarginParameters | None:
        """The margins of the session; None without one."""
        changes = None if self._run is None else self._run.steps.changes
        return None if changes is None else changes.scene.margins

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Use these from the next step on; refused whole when one of them cannot be."""
        self._session_run().steps.set_margins(stop_mm, warn_mm)

    def set_tumor(self, node: vtkMRMLNode | None, segment: str = "") -> None:
        """Guard what ``node`` marks now; its field is built beside this thread."""
        changes = self._session_run().steps.changes
        if changes is None or self.display is None:
            raise InputError("the session has not shown its tumour yet: it cannot be replaced")
        edge = changes.setup.frame_from_tumor
        mesh = surface_of(node, segment, edge.source, self.display.tumor_node())

        def done(model_id: str) -> None:
            self._message = f"the tumour is now {model_id}"

        self._jobs.begin("setting the tumour", lambda: changes.set_tumor(edge, mesh), done)

    def register_case(self, folder: Path) -> None:
        """Find the registration of a recorded case beside this thread, to be accepted."""
        self._jobs.begin("registering", lambda: registration_of_case(folder), self._propose)

    def register_landmarks(
        self, in_reference: vtkMRMLMarkupsNode | None, in_base: vtkMRMLMarkupsNode | None
    ) -> None:
        """Register by points marked in the scene and the same points in the robot's base.

        ``in_reference`` is taken where the scene has it, relative to the reference's node;
        ``in_base`` by its own coordinates.
        """
        changes = self._session_run().steps.changes
        if in_reference is None or in_base is None:
            raise InputError("two lists of landmarks are wanted: in the reference, in the base")
        if changes is None or changes.setup.robot is None or self.display is None:
            raise InputError("the session has no robot whose base could be registered")
        fixed_mm = points_of_markups(in_reference, self.display.reference_node())
        moving_mm = points_of_markups(in_base, in_base.GetParentTransformNode())
        self._propose(
            registration_of_landmarks(fixed_mm, moving_mm, changes.setup.robot.base_frame)
        )

    def accept_registration(self) -> None:
        """Use the registration that was found, from the next step on."""
        changes = self._session_run().steps.changes
        if self.candidate is None or changes is None:
            raise InputError("there is no registration to accept: register first")
        changes.set_registration(self.candidate)
        self.candidate = None
        self._message = "the registration is in use"

    def set_opacity(self, opacity: float) -> None:
        """Of the tumour, 0 to 1, for this display and the next ones."""
        self._opacity = opacity
        if self.display is not None:
            self.display.set_opacity(opacity)

    def set_patient_to_ras(self, node: vtkMRMLTransformNode | None) -> None:
        """Where the reference is drawn; None: at the world's origin."""
        self._patient_to_ras = node
        if self.display is not None:
            self.display.hang_under(node)

    def look(self, preset: Preset) -> None:
        """Look at the tumour from one side, and stay there."""
        self._follow = None
        self._shown().look(self._camera(), preset)

    def follow_tool(self, follow: bool) -> None:
        """Look along the tool from now on, or stay where the view is."""
        self._follow = None
        if follow:
            self._shown().look_along_tool(self._camera())
            self._follow = self._camera()

    @property
    def is_following(self) -> bool:
        """Whether the view follows the tool."""
        return self._follow is not None

    def spin(self, wait_s: float = WAIT_S) -> PanelStatus:
        """Show the newest step, grey what has become old, and tell how everything is."""
        failed = self._jobs.collect()
        if failed:
            self._message = failed
        if self._run is not None:
            self._take(self._run, wait_s)
            if self._run.failure:
                self._message = self._run.failure
        self._jobs.wait(wait_s)
        return self._status()

    def wants_alarm(self) -> bool:
        """Whether the alarm is to sound now."""
        return self.alarm.due(self._readout()[0], self._clock_ns())

    def forget_scene(self) -> None:
        """The scene is being closed: end the session, whose nodes go with it."""
        self._end_session()

    def close(self) -> None:
        """End the session and the jobs; its nodes leave the scene."""
        self._end_session()
        self._jobs.close()

    def _take(self, run: Run, wait_s: float) -> None:
        delivered = run.newest(wait_s)
        changes = run.steps.changes
        if delivered is not None and changes is not None:
            if self.display is None:
                self.display = SessionDisplay(
                    self._mrml_scene, changes.scene, changes.setup, self._opacity
                )
            elif self._last is None or self._last.run is not run:
                self.display.restart()
            self._last = delivered
            self._health = self.display.show(
                delivered.step, changes.scene, run.present_ns(delivered)
            )
            self.display.hang_under(self._patient_to_ras)
        elif self._last is not None and self.display is not None:
            self._health = self.display.check(run.present_ns(self._last))
        if self._follow is not None and self.display is not None:
            self.display.look_along_tool(self._follow)

    def _begin(self, steps: Steps) -> None:
        self._message = ""
        self._run = Run(steps, self._clock_ns)

    def _seek(self, case: OpenedCase, seconds: float, *, paused: bool) -> None:
        if not 0.0 <= seconds <= case.duration_s:
            raise InputError(f"seek to {seconds:g} s: 0 to {case.duration_s:.1f} s wanted")
        setup, shown = case.setup, case.scene
        if self._run is not None and self._run.steps.changes is not None:
            self._run.stop()
            changes = self._run.steps.changes
            setup, shown = changes.setup, changes.scene
        self._begin(
            ReplaySteps(case, setup, shown, start_s=seconds, rate=self._rate, paused=paused)
        )

    def _end_session(self) -> None:
        if self._run is not None:
            self._run.stop()
        if self.display is not None:
            self.display.clear()
        self._run = self._opened = self._last = self.display = None
        self._follow = self.candidate = None
        self._health = ()

    def _propose(self, result: RegistrationResult) -> None:
        self.candidate = result
        self._message = ""

    def _status(self) -> PanelStatus:
        state, banner = self._readout()
        step = None if self._last is None else self._last.step
        running = self._run is not None and not self._run.is_over
        opened = self._opened
        position_s = None
        if opened is not None and step is not None:
            position_s = (step.frame.stamp.ns - opened.first_ns) / NS_PER_S
        return PanelStatus(
            state=state,
            banner=banner,
            reasons=self._reasons(state),
            trackers="\n".join(health.text for health in self._health),
            session=self._session_text(running),
            registration="" if self.candidate is None else registration_text(self.candidate),
            message=f"{self._jobs.at_work} ..." if self._jobs.at_work else self._message,
            position_s=position_s,
            duration_s=0.0 if opened is None else opened.duration_s,
            is_live=running and opened is None,
            has_session=running,
            is_playing=running and opened is not None and not self._replay().player.paused,
            can_accept=running and self.candidate is not None and self.candidate.accepted,
        )

    def _reasons(self, state: MarginState) -> str:
        """Those of the decision, or the one for which it is not shown any more."""
        if self._last is None:
            return ""
        decision = self._last.step.decision
        if state is not decision.state:
            return str(Reason.STALE)
        return ", ".join(map(str, decision.reasons))

    def _session_text(self, running: bool) -> str:
        if self._run is None:
            return "no session"
        opened = self._opened
        if opened is None:
            if not running:
                return "live session has ended"
            return "live" if self._last is not None else "connecting ..."
        name = f"{opened.case.manifest.name} ({opened.case.manifest.provenance.kind})"
        if not running:
            return f"{name}: ended"
        if self._replay().player.paused:
            return f"{name}: paused"
        return f"{name}: playing"

    def _readout(self) -> tuple[MarginState, str]:
        if self.display is None:
            return MarginState.UNKNOWN, NOTHING_YET
        return self.display.readout()

    def _session_run(self) -> Run:
        if self._run is None or self._run.is_over:
            raise InputError("there is no session: connect or load a case first")
        return self._run

    def _case(self) -> OpenedCase:
        if self._opened is None:
            raise InputError("no case is loaded: load one first")
        return self._opened

    def _replay(self) -> ReplaySteps:
        if self._opened is None or self._run is None:
            raise InputError("no case is loaded: load one first")
        steps = self._run.steps
        if not isinstance(steps, ReplaySteps):
            raise InputError("the session is live: a replay is controlled this way")
        return steps

    def _shown(self) -> SessionDisplay:
        if self.display is None:
            raise InputError("nothing is shown yet: connect or load a case first")
        return self.display

    def _camera(self) -> vtkMRMLCameraNode:
        camera = self._mrml_scene.GetFirstNodeByClass("vtkMRMLCameraNode")
        if camera is None:
            raise InputError("the scene has no 3D view to look through")
        return camera
