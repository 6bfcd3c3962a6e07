"""Changes of a running session by an operator, each between two steps, completely or not at all."""

from collections.abc import Callable
from dataclasses import replace

from app.fixture import MarginParameterError, MarginParameters
from app.geometry import InputError, Transform
from app.hold import SeenHold, margin_changes, tip_change_text
from app.registration import RegistrationResult
from app.runtime.case_recorder import CaseRecorder, RecordingStatus
from app.runtime.display_items import ShownChange
from app.runtime.requests import RequestKind
from app.runtime.session_changes import check_tip
from app.runtime.structure_commands import StructureCommands

_STEPS_WAIT_S = 0.5
"""For several changes in a row, each of which waits for a step."""


class OperatorCommands(StructureCommands):
    """Re-arm a session, record it, or replace its margins, structures, tip or registration.

    A command that is refused raises before anything has changed. A change that loosens what the
    session permits latches a hold (`app.session.Session.use`), and every display shows its
    causes. Each command and its outcome is listed in ``requests``; ``origin`` is the interface on
    which it arrived.
    """

    keep_margins: Callable[[float, float, str], None] | None = None
    """Changes ``stop_mm`` and ``warn_mm`` for an origin, where `set_margins` is called for."""

    def seen(self) -> SeenHold:
        """Identifies the hold of the step that was published last, to be displayed with it."""
        return self._holds.present()

    def check_rearm(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` for a hold that is not the present one, without waiting.

        A flood of such requests takes neither a thread nor the session's lock.
        """
        self._holds.check(seen)

    def rearm(self, seen: SeenHold, *, origin: str) -> None:
        """End the present hold, which the operator has seen as ``seen``.

        Raises `RearmRefusedError` if another fault, tumour, registration or looser margin came
        since, and `NotRearmableError` while the state is UNKNOWN.
        """
        with self._listed(RequestKind.REARM, origin) as done, self._between_steps() as session:
            # Between two steps, so that neither a fault nor a change can come in between.
            self._holds.check(seen)
            causes = session.hold_causes
            content = self._content.with_margins(session.requested)
            switches = self._prepare(content)
            session.rearm()
            self._holds.consume(seen)
            before = self._content.margins, self._content.structures
            if (content.margins, content.structures) != before:
                self._switch(content, switches)
            self._acknowledged = self._content
            done.append(f"the hold is ended: {'; '.join(causes) or 'no cause was noted'}")

    def use_margins(self, stop_mm: float, warn_mm: float, origin: str) -> None:
        """Use both as `set_margins`, where they are kept: a live node has them as parameters."""
        if self.keep_margins is not None:
            self.keep_margins(stop_mm, warn_mm, origin)
            return
        try:
            margins = self.requested.margins.replaced(stop_mm=stop_mm, warn_mm=warn_mm)
        except MarginParameterError as error:
            self.requests.refused(RequestKind.MARGINS, origin, str(error))
            raise
        self.set_margins(margins, origin=origin)

    def set_margins(self, margins: MarginParameters, *, origin: str) -> None:
        """Use ``margins`` from the next step on; what is looser latches a hold and waits for it.

        Raises `InputError` while another change is being prepared: the caller may be the thread
        that receives the poses, which must not wait for seconds.
        """
        with self._listed(RequestKind.MARGINS, origin) as done, self._change_at_once("margins"):
            switches = self._prepare(replace(self._content, margins=margins))
            with self._between_steps() as session:
                changes = margin_changes(session.requested.margins, margins)
                setup = replace(session.requested, margins=margins)
                loosened = self._apply(session, setup, self._content, switches)
            text = ", ".join(changes) or "no value has changed"
            done.append(f"{text} (a re-arm is needed)" if loosened else text)

    def set_registration(self, registration: RegistrationResult, *, origin: str) -> str:
        """Use this registration of the robot's base; returns its ``registration_id``.

        Latches a hold. Raises `InputError` without a robot and for a registration that was not
        accepted, and `FrameError` for one between other frames.
        """
        with self._listed(RequestKind.REGISTRATION, origin) as done, self._changing:
            if not registration.accepted:
                raise InputError(
                    f"registration: not accepted, {registration.reason}; expected an accepted one"
                )
            robot = self.setup.robot
            if robot is None:
                raise InputError("registration: the session has no robot; expected one")
            of_robot = replace(robot, registration=registration)
            self._change(lambda each: each.with_edge(registration.transform, robot=of_robot))
            done.append(self._content.registration_id)
        return self._content.registration_id

    @property
    def recording(self) -> RecordingStatus | None:
        """State of the last recording of the session; None before the first."""
        return None if self._recorder is None else self._recorder.status

    def start_recording(self, name: str = "", *, origin: str) -> RecordingStatus:
        """Record the session as a new case called ``name``, or by date. Takes seconds.

        The case contains the structures, tip, registration and margins in use now; those that are
        replaced while it is recorded are noted in it.

        Raises `InputError` as `CaseRecorder.start`; the session is not affected.
        """
        with self._listed(RequestKind.RECORD, origin) as done:
            recorder, content = self._recording_by(), self._content
            folder = recorder.start(name, content.values(self._initial))
            recorder.note_replaced(self._content.replaced_since(content))
            if self._content.image_depth != content.image_depth:
                recorder.note_depth()
            done.append(f"recording to {folder}")
        return recorder.status or RecordingStatus(folder, active=True)

    def stop_recording(self, *, origin: str) -> RecordingStatus:
        """Finish the running recording. Raises `InputError` without one."""
        with self._listed(RequestKind.RECORD, origin) as done:
            status = self._recording_by().stop()
            done.append(status.line)
        return status

    def _recording_by(self) -> CaseRecorder:
        if self._recorder is None:
            raise InputError("recording: the session has no recorder; expected a live session")
        return self._recorder

    def set_tip(self, tool_from_tip: Transform, *, sigma_mm: float = 0.0, origin: str) -> None:
        """Use this tip of the tool; the tool's surface moves with its frame. Latches a hold.

        ``sigma_mm``: standard deviation of the tip in its worst direction, 0 where it is not
        stated. Raises `FrameError` for a tip between other frames, and `InputError` for an
        uncertainty out of range, and for another axis of a tool whose mount on a robot was found
        with the axis in use.
        """
        with self._listed(RequestKind.TIP, origin) as done, self._changing:
            setup = self.setup
            known, robot = setup.tool_from_tip, setup.robot
            check_tip(setup, tool_from_tip, sigma_mm)
            self._change(lambda each: each.with_edge(tool_from_tip, tip_sigma_mm=sigma_mm))
            change = f"{tip_change_text(known, tool_from_tip)}, sigma {sigma_mm:.2f} mm"
            done.append(change if robot is None else f"{change}; register the robot again")

    def change_shown(self, kind: str, change: ShownChange, *, origin: str) -> None:
        """Change what is shown (`app.runtime.display_items`); state, constraint and hold stay.

        Raises `InputError` for what the change refuses, and while another one is being prepared.
        """
        with self._listed(kind, origin) as done, self._change_at_once(kind, _STEPS_WAIT_S):
            content, text = change(self._content)
            switches = self._prepare(content)
            with self._between_steps():
                # Nothing is revoked: permissions do not depend on what is drawn.
                content, text = change(self._content)
                for switch in switches:
                    switch(content)
                if self._acknowledged is self._content:
                    self._acknowledged = content
                self._content = content
            done.append(text)
