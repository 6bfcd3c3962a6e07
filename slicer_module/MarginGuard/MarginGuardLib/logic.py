"""The panel's commands. No Qt and no maths: it connects a session, its display and jobs.

Everything here is for the scene's thread; `PanelLogic.spin` is called by its timer.
"""

import time
from collections.abc import Callable
from pathlib import Path

from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLCameraNode,
    vtkMRMLMarkupsNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.fixture import MarginParameters
from app.geometry import InputError, MarginGuardError
from app.registration import RegistrationResult
from app.runtime import PreparedCase, prepare_case
from app.scene import Preset, points_of_markups

from .alarm import Alarm
from .jobs import Jobs, one_line
from .live_opening import LiveOpening
from .registering import (
    registration_of_case,
    registration_of_landmarks,
    registration_text,
)
from .shown_session import ShownSession
from .status import PanelStatus
from .tumor_input import surface_of

WAIT_S = 0.005
"""How long a spin waits for a step, so that other threads can run meanwhile."""


class PanelLogic:
    """Commands for one session at a time, live or replayed, shown in ``mrml_scene``.

    With the application's ``logic`` its views draw once a step.

    A command that cannot be executed raises `MarginGuardError` with one line for the user. Later
    errors are in the status.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        logic: vtkMRMLApplicationLogic | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.alarm = Alarm()
        self.session = ShownSession(mrml_scene, logic, clock_ns)
        self.candidate: RegistrationResult | None = None
        self._mrml_scene = mrml_scene
        self._clock_ns = clock_ns
        self._jobs = Jobs()
        self._message = ""
        self._follow: vtkMRMLCameraNode | None = None

    def connect(self, config: Path) -> None:
        """Start a live session with this ``live.yaml``; errors in it are in the status.

        Ends a replay. Refused during a live session, which has to be disconnected first.
        """
        self._check_not_live()
        self.forget_scene()
        self.session.begin(LiveOpening(config))

    def disconnect(self) -> None:
        """End the session soon; what it displayed turns grey."""
        self.session.running().run.stop()

    def load_case(self, folder: Path) -> None:
        """Open and register a recorded case in a worker thread; it is then paused at its start.

        Refused during a live session.
        """
        self._check_not_live()
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; expected a case")

        def opened(case: PreparedCase) -> None:
            self._end()
            self.session.begin_replay(case)

        self._jobs.begin("opening the case", lambda: prepare_recorded(folder), opened)

    def play(self) -> None:
        """Resume the replay; restart it if it has ended."""
        replay = self.session.replay()
        if self.session.is_running:
            replay.player.resume()
        else:
            self.session.seek(0.0, paused=False)

    def pause(self) -> None:
        """Pause the replay at the displayed frame."""
        self.session.replay().player.pause()

    def step(self) -> None:
        """Show the next frame, and stay paused."""
        self.session.replay().player.step()

    def seek(self, seconds: float) -> None:
        """Seek, with a new session; a paused replay stays paused."""
        self.session.seek(seconds, paused=self.session.replay().player.paused)

    def set_rate(self, rate: float) -> None:
        """Set the rate (recorded time over clock time) of this replay and the next ones."""
        if self.session.opened is not None:
            self.session.replay().set_rate(rate)
        self.session.rate = rate

    def rearm(self) -> None:
        """End the hold of an earlier fault; the operator sees the present display."""
        self.session.rearm()

    def margins(self) -> MarginParameters | None:
        """The margins of the session; None without one."""
        thread = self.session.thread
        commands = None if thread is None else thread.run.commands
        return None if commands is None else commands.content.margins

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Use these margins from the next step on; if one is invalid, both are refused."""
        self.session.running().run.set_margins(stop_mm, warn_mm)

    def set_tumor(self, node: vtkMRMLNode | None, segment: str = "") -> None:
        """Use the present surface of ``node`` as tumour; its field is built in a worker thread."""
        commands = self.session.commands()
        edge = commands.setup.frame_from_tumor
        mesh = surface_of(node, segment, edge.source, self.session.shown().tumor_node())

        def done(model_id: str) -> None:
            if commands is not self.session.commands():
                raise InputError("another session has started meanwhile: set the tumour again")
            self._message = f"the tumour is now {model_id}"

        self._jobs.begin("setting the tumour", lambda: commands.set_tumor(edge, mesh), done)

    def register_case(self, folder: Path) -> None:
        """Compute the registration of a recorded case in a worker thread, for acceptance."""
        self._jobs.begin("registering", lambda: registration_of_case(folder), self._propose)

    def register_landmarks(
        self, in_reference: vtkMRMLMarkupsNode | None, in_base: vtkMRMLMarkupsNode | None
    ) -> None:
        """Register by points marked in the scene and the same points in the robot's base.

        ``in_reference`` is used relative to the reference's node, ``in_base`` in its own
        coordinates.
        """
        robot = self.session.commands().setup.robot
        if in_reference is None or in_base is None:
            raise InputError(
                "landmarks: a list is missing; expected one in the reference, one in the base"
            )
        if robot is None:
            raise InputError("registration: the session has no robot; expected one")
        fixed_mm = points_of_markups(in_reference, self.session.shown().reference_node())
        moving_mm = points_of_markups(in_base, in_base.GetParentTransformNode())
        self._propose(registration_of_landmarks(fixed_mm, moving_mm, robot.base_frame))

    def accept_registration(self) -> None:
        """Use the proposed registration from the next step on."""
        commands = self.session.commands()
        if self.candidate is None:
            raise InputError("there is no registration to accept: register first")
        commands.set_registration(self.candidate)
        self.candidate = None
        self._message = "the registration is in use"

    def set_opacity(self, opacity: float) -> None:
        """Set the tumour's opacity, 0 to 1, of this display and the next ones."""
        self.session.opacity = opacity
        if self.session.display is not None:
            self.session.display.set_opacity(opacity)

    def set_patient_to_ras(self, node: vtkMRMLTransformNode | None) -> None:
        """Place the reference below ``node``; None places it at the world's origin.

        Raises `SceneError` for a node of the session itself.
        """
        if self.session.display is not None:
            self.session.display.set_patient_to_ras(node)
        self.session.patient_to_ras = node

    def look(self, preset: Preset) -> None:
        """Point the camera at the tumour from one side, and stop following the tool."""
        self._follow = None
        self.session.shown().look(self._camera(), preset)

    def follow_tool(self, follow: bool) -> None:
        """Let the camera follow the tool, or stop following."""
        self._follow = None
        if follow:
            self.session.shown().look_along_tool(self._camera())
            self._follow = self._camera()

    @property
    def is_following(self) -> bool:
        """True while the camera follows the tool."""
        return self._follow is not None

    def spin(self, wait_s: float = WAIT_S) -> PanelStatus:
        """Show the newest step, grey out stale data, and return the status."""
        failed = self._jobs.collect()
        if failed:
            self._message = failed
        session = self.session
        session.take(wait_s)
        if session.thread is not None and session.thread.failure:
            self._message = session.thread.failure
        if session.failure:
            self._message = session.failure
        self._look_along_tool()
        self._jobs.wait(wait_s)
        return self._status()

    def wants_alarm(self) -> bool:
        """True if the alarm has to sound now."""
        return self.alarm.due(self.session.readout()[0], self._clock_ns())

    def forget_scene(self) -> None:
        """End the session, drop its jobs, and remove its nodes from the scene."""
        self._jobs.forget()
        self._end()

    def close(self) -> None:
        """End the session and the jobs."""
        self.forget_scene()
        self._jobs.close()

    def _look_along_tool(self) -> None:
        """Update the following camera; stop following when that fails, as without a camera."""
        if self._follow is None or self.session.display is None:
            return
        try:
            self.session.display.look_along_tool(self._follow)
        except MarginGuardError as error:
            self._follow = None
            self._message = one_line(error)

    def _end(self) -> None:
        self.session.end()
        self._follow = self.candidate = None
        self._message = ""

    def _check_not_live(self) -> None:
        if self._is_live:
            raise InputError("a live session is running: disconnect first")

    @property
    def _is_live(self) -> bool:
        return self.session.is_running and self.session.opened is None

    def _propose(self, result: RegistrationResult) -> None:
        self.candidate = result
        self._message = ""

    def _status(self) -> PanelStatus:
        session = self.session
        state, banner = session.readout()
        return PanelStatus(
            state=state,
            banner=banner,
            reasons=session.reasons(),
            trackers="\n".join(health.text for health in session.health),
            session=session.text(),
            registration="" if self.candidate is None else registration_text(self.candidate),
            message=f"{self._jobs.running} ..." if self._jobs.running else self._message,
            position_s=session.position_s,
            duration_s=0.0 if session.opened is None else session.opened.extent.duration_s,
            is_live=self._is_live,
            has_session=session.is_running,
            is_playing=session.is_playing,
            can_accept=session.is_running
            and self.candidate is not None
            and self.candidate.accepted,
        )

    def _camera(self) -> vtkMRMLCameraNode:
        camera = self._mrml_scene.GetFirstNodeByClass("vtkMRMLCameraNode")
        if camera is None:
            raise InputError("the scene has no 3D view; expected one")
        return camera


def prepare_recorded(folder: Path) -> PreparedCase:
    """Open and register the case; reads its extent, so that an empty recording is refused here."""
    prepared = prepare_case(folder)
    _ = prepared.extent
    return prepared
