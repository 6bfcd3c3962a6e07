"""Commands of the panel's buttons. Without Qt: connects a session, its display and jobs.

Call everything in the scene's thread, and `PanelLogic.spin` when something has changed.
"""

import time
from collections.abc import Callable
from pathlib import Path

from slicer import vtkMRMLApplicationLogic, vtkMRMLMarkupsNode, vtkMRMLNode, vtkMRMLScene

from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_S, InputError
from app.registration import RegistrationResult, register_points
from app.runtime import (
    Record,
    RecordingStatus,
    SetMargins,
    SetRegistration,
    SetTumor,
    SwitchStructure,
    register_case,
)
from app.scene import points_of_markups
from app.session import REFERENCE
from app.workflow import (
    GuidedShown,
    RobotRegistration,
    ToolCalibration,
    Workflow,
    calibration_shown,
    registration_shown,
    workflow_steps,
)

from .contour import PanelContour
from .events import SessionEvents
from .live_step_run import LiveStepRun
from .panel_inputs import RecordedCase, prepare_recorded, registration_text, surface_of
from .plans import PanelPlans
from .shown_session import ShownSession
from .status import Alarm, PanelStatus
from .ultrasound import PanelUltrasound
from .view import PanelDirections, PanelItems, PanelView

STATUS_NS = NS_PER_S // 20
"""Interval of the status while the state does not change."""


class PanelLogic:
    """Commands for one session at a time, live or replayed, shown in ``mrml_scene``.

    With the application's ``logic`` its views draw once per step.

    A command that is refused raises `MarginGuardError` with one line for the user. The status
    contains errors that occur later. ``changed()`` is called in any thread when there is a new step
    or a job is done: `spin` then, and at least every 0.1 s, or a silent session does not turn grey.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        logic: vtkMRMLApplicationLogic | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.alarm = Alarm()
        self.session = ShownSession(mrml_scene, logic, clock_ns, changed)
        self.view = PanelView(self.session, mrml_scene)
        self.events = SessionEvents(self.session, mrml_scene)
        self._directions = PanelDirections(changed)
        self.candidate: RegistrationResult | None = None
        self._mrml_scene = mrml_scene
        self._clock_ns = clock_ns
        self._displayed_state: MarginState | None = None
        self._displayed_ns = 0
        self._jobs = self.session.jobs
        self.contour = PanelContour(self.session, mrml_scene, logic, changed)
        self.items = PanelItems(self.session)
        self.ultrasound = PanelUltrasound(self.session, mrml_scene)
        self.plans = PanelPlans(self.session)
        self._message = ""

    def connect(self, config: Path) -> None:
        """Start a live session with this ``live.yaml``; the status reports an invalid file.

        Ends a replay. Raises `InputError` during a live session, which only `disconnect` ends.
        """
        self._check_not_live()
        self.end_session()
        self.session.begin(LiveStepRun(str(config), self.session.workflow_of))

    def disconnect(self) -> None:
        """Stop the session without waiting for its end; its display becomes grey."""
        self.session.running().run.stop()

    def load_case(self, folder: Path) -> None:
        """Open and register a recorded case in the background; then pause at its first frame.

        Raises `InputError` during a live session and for a folder that does not exist.
        """
        self._check_not_live()
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; expected the folder of a case")

        def opened(recorded: RecordedCase) -> None:
            self._end()
            self.session.begin_replay(recorded.case, recorded.breaches)
            self.ultrasound.replay(recorded.images)

        self._jobs.submit("opening the case", lambda: prepare_recorded(folder), opened)

    def play(self) -> None:
        """Resume the replay; start from the beginning if it has ended."""
        replay = self.session.replay()
        if self.session.is_running:
            replay.player.resume()
        else:
            self.session.seek(0.0, paused=False)

    def pause(self) -> None:
        """Pause the replay at the displayed frame."""
        self.session.replay().player.pause()

    def step(self) -> None:
        """Show the next frame and stay paused."""
        self.session.replay().player.step()

    def seek(self, seconds: float) -> None:
        """Continue at ``seconds`` with a new session; a paused replay stays paused."""
        self.session.seek(seconds, paused=self.session.replay().player.paused)

    def set_rate(self, rate: float) -> None:
        """Set recorded time over clock time, for this replay and later ones."""
        if self.session.opened is not None:
            self.session.replay().set_rate(rate)
        self.session.rate = rate

    def rearm(self) -> None:
        """End the hold of an earlier fault, based on the displayed step."""
        self.session.request(self.session.rearm())

    def record(self, start: bool) -> None:
        """Start to record the live session as a new case, or finish it, in the background."""
        operator = self.session.started()
        name = "starting the recording" if start else "finishing the recording"
        self._jobs.submit(name, lambda: operator.request(Record(start)), lambda written: None)

    def margins(self) -> MarginParameters | None:
        """The margins of the session; None without one."""
        operator = self.session.operator
        return None if operator is None else operator.content.margins

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Use both from the next step on; if one is invalid, neither is changed."""
        self.session.running()
        self.session.request(SetMargins(stop_mm, warn_mm))

    def switch_structure(self, name: str, on: bool, reason: str) -> None:
        """Guard a structure no more, for a ``reason``, or again."""
        self.session.running()
        self.session.request(SwitchStructure(name, on, reason.strip()))

    def set_tumor(self, node: vtkMRMLNode | None, segment: str = "") -> None:
        """Use the surface of ``node`` as tumour; its distance field is built in the background."""
        operator = self.session.started()
        edge = operator.content.frame_from_tumor
        mesh = surface_of(node, segment, edge.source, self.session.shown().tumor_node())

        def done(model_id: str) -> None:
            if operator is not self.session.operator:
                raise InputError("another session has started; expected the same one: set it again")
            self._message = f"the tumour is now {model_id}"

        self._jobs.submit(
            "setting the tumour", lambda: operator.request(SetTumor(edge, mesh)), done
        )

    def register_case(self, folder: Path) -> None:
        """Compute the registration of a recorded case in the background, as `candidate`."""
        self._jobs.submit("registering", lambda: register_case(folder).registration, self._propose)

    def register_landmarks(
        self, in_reference: vtkMRMLMarkupsNode | None, in_base: vtkMRMLMarkupsNode | None
    ) -> None:
        """Register points marked in the scene with the same points in the robot's base.

        The points of ``in_reference`` are converted to the reference's node, those of ``in_base``
        are used as they are.
        """
        robot = self.session.started().content.robot
        if in_reference is None or in_base is None:
            raise InputError(
                "landmarks: a list is not chosen; expected two, in the reference and in the base"
            )
        if robot is None:
            raise InputError("registration: the session has no robot; expected one")
        fixed_mm = points_of_markups(in_reference, self.session.shown().reference_node())
        moving_mm = points_of_markups(in_base, in_base.GetParentTransformNode())
        self._propose(
            register_points(
                fixed_mm, moving_mm, fixed_frame=REFERENCE, moving_frame=robot.base_frame
            )
        )

    def accept_registration(self) -> None:
        """Use `candidate` from the next step on."""
        operator, candidate = self.session.started(), self.candidate
        if candidate is None:
            raise InputError("there is no registration to accept; expected one: register first")

        def done(_: str) -> None:
            if self.candidate is candidate:
                self.candidate = None
            self._message = "the registration is in use"

        self._jobs.submit(
            "using the registration", lambda: operator.request(SetRegistration(candidate)), done
        )

    def calibration(self) -> ToolCalibration:
        """The guided calibration of the tool; raises `InputError` without a session."""
        return self._guided().calibration

    def touch(self) -> RobotRegistration:
        """The guided registration of the robot; raises `InputError` without one."""
        registration = self._guided().registration
        if registration is None:
            raise InputError("registration: the session has no robot; expected one")
        return registration

    def refresh(self, wait_s: float = 0.0) -> PanelStatus:
        """Show the newest step in the scene, and return the status, to be displayed at once."""
        self._update(wait_s)
        self._displayed_state, self._displayed_ns = self.session.readout()[0], self._clock_ns()
        return self._status()

    def spin(self) -> PanelStatus | None:
        """Update like `refresh`; None if a status of this state is less than `STATUS_NS` old.

        The scene follows every step. Nobody reads texts that change as fast, and writing them
        takes longer than moving the scene.
        """
        self._update(0.0)
        state, age_ns = self.session.readout()[0], self._clock_ns() - self._displayed_ns
        if state is self._displayed_state and 0 <= age_ns < STATUS_NS:
            return None
        self._displayed_state, self._displayed_ns = state, self._clock_ns()
        return self._status()

    def _update(self, wait_s: float) -> None:
        """Wait for a step and for the running job, for each at most ``wait_s``."""
        failure = self._jobs.collect() or self.session.requests.collect()
        if failure:
            self._message = failure
        session = self.session
        session.update(wait_s)
        if session.thread is not None and session.thread.failure:
            self._message = session.thread.failure
        if session.failure:
            self._message = session.failure
        workflow, operator = session.workflow, session.operator
        self.contour.update(operator)
        if workflow is not None and operator is not None:
            workflow.guided.update(operator.content)
        self.view.update()
        self.ultrasound.update()
        self.plans.update()
        self.contour.note_pixel(self.ultrasound.pixel_mm)
        if self.view.failure:
            self._message = self.view.failure
        self._jobs.wait(wait_s)
        session.requests.wait(wait_s)

    def alarm_due(self) -> bool:
        """Return True if the alarm has to sound now."""
        return self.alarm.due(self.session.readout()[0], self._clock_ns())

    def end_session(self) -> None:
        """End the session, cancel the jobs and remove the session's nodes from the scene."""
        self._jobs.cancel()
        self._end()

    def close(self) -> None:
        """End the session and the jobs."""
        self.end_session()
        self._jobs.close()
        self.session.requests.close()
        self._directions.close()
        self.contour.close()

    def _guided(self) -> Workflow:
        self.session.running()
        if self.session.workflow is None:
            raise InputError("the session has not begun; expected the request later")
        return self.session.workflow.guided

    def _end(self) -> None:
        self.contour.clear()
        self.ultrasound.clear()
        self.plans.clear()
        self.session.end()
        self.view.end()
        self.candidate = None
        self._message = ""

    def _check_not_live(self) -> None:
        if self._is_live:
            raise InputError("a live session is running; expected none: disconnect first")

    @property
    def _is_live(self) -> bool:
        return self.session.is_running and self.session.opened is None

    def _propose(self, result: RegistrationResult) -> None:
        self.candidate = result
        self._message = ""

    def _workflow(self) -> str:
        """The steps of the case, one line each; empty before a session shows something."""
        session = self.session
        shown, operator = session.shown_step, session.operator
        if shown is None or operator is None:
            return ""
        is_stale = session.readout()[0] is not shown.decision.state
        guided = None if session.workflow is None else session.workflow.guided
        steps = workflow_steps(
            shown,
            operator.content,
            is_live=session.opened is None,
            silent="" if session.is_running and not is_stale else "no step has followed",
            calibration=None if guided is None else guided.calibration.status(),
            recording=self._recording(),
        )
        return "\n".join(each.line for each in steps)

    def _tip_directions(self) -> str:
        session, operator = self.session, self.session.operator
        step = session.shown_step
        if step is None or operator is None or session.readout()[0] is not step.decision.state:
            return ""
        return self._directions.text(step, operator.content, operator.compute)

    def _structures(self) -> tuple[tuple[str, bool], ...]:
        step = self.session.shown_step
        if step is None:
            return ()
        guarded = [(each.name, True) for each in step.structures[1:]]
        return (*guarded, *((name, False) for name in step.off))

    def _recording(self) -> RecordingStatus | None:
        operator = self.session.operator
        return None if operator is None else operator.recording

    def _status(self) -> PanelStatus:
        session, recording = self.session, self._recording()
        state, _ = session.readout()
        shown, banner = session.banner()
        workflow = session.workflow if session.is_running else None
        calibration = None if workflow is None else workflow.guided.calibration
        touch = None if workflow is None else workflow.guided.registration
        fit = None if calibration is None else calibration.status().fit
        return PanelStatus(
            state=state,
            shown=shown,
            banner=banner,
            reasons=session.reasons(),
            trackers="\n".join(health.text for health in session.health),
            session=session.text(),
            registration="" if self.candidate is None else registration_text(self.candidate),
            message=f"{self._jobs.current} ..." if self._jobs.current else self._message,
            request=session.last_request(),
            position_s=session.position_s,
            duration_s=0.0 if session.opened is None else session.opened.extent.duration_s,
            is_live=self._is_live,
            has_session=session.is_running,
            is_playing=session.is_playing,
            can_accept=session.is_running
            and self.candidate is not None
            and self.candidate.accepted,
            recording="" if recording is None else recording.line,
            is_recording=recording is not None and recording.active,
            workflow=self._workflow(),
            directions=self._tip_directions(),
            activation=self.session.activation(),
            calibration=GuidedShown() if calibration is None else calibration_shown(calibration),
            coverage=None if fit is None else fit.coverage,
            touch=GuidedShown() if touch is None else registration_shown(touch),
            contour=self.contour.shown(),
            items=self.items.shown(),
            ultrasound=self.ultrasound.shown(),
            tools=self.items.tools(),
            structures=self._structures(),
            plans=self.plans.shown(),
        )
