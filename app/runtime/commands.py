"""Changes of a running session by an operator, each between two steps, completely or not at all."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from typing import Any

from app.fixture import MarginParameterError, MarginParameters
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.hold import Holds, SeenHold, margin_changes, tip_change_text
from app.registration import RegistrationResult
from app.runtime.case_recorder import CaseRecorder, RecordingStatus
from app.runtime.compute import Compute, compute_here
from app.runtime.content import SessionContent
from app.runtime.display_content import ShownChange
from app.runtime.outputs import Output, SwitchContent
from app.runtime.replacements import check_size, check_tip, replacement_for
from app.runtime.requests import RequestKind, RequestLog
from app.session import Session, SessionSetup

BetweenSteps = Callable[[], AbstractContextManager[Session]]
"""Gives exclusive access to the session between two steps, as `LiveSession.between_steps` does."""

MAX_TUMOR_SIGMA_MM = 10.0
"""Largest uncertainty of a tumour's surface, as in ``tumor.sigma_mm`` of a ``case.yaml``."""

_SHORT_WAIT_S = 0.05
_STEPS_WAIT_S = 0.5
"""For several changes in a row, each of which waits for a step."""


class OperatorCommands:
    """Re-arm a session, record it, or replace its margins, tumour, tip or the robot's registration.

    Slow work (distance field and surfaces of a new tumour) is done before the session is locked.
    A command that is refused raises before anything has changed. A change that loosens what the
    session permits latches a hold (`app.session.Session.use`), and every display shows its
    causes. Each command and its outcome is listed in ``requests``; ``origin`` is the interface on
    which it arrived. ``holds`` identifies the present hold. ``max_triangles`` limits a new tumour,
    which ``compute`` prepares. ``recorder`` records the session; None for one that cannot be.
    """

    def __init__(
        self,
        between_steps: BetweenSteps,
        content: SessionContent,
        outputs: Sequence[Output],
        *,
        holds: Holds,
        max_triangles: int | None = None,
        requests: RequestLog | None = None,
        compute: Compute = compute_here,
        recorder: CaseRecorder | None = None,
    ) -> None:
        self._between_steps = between_steps
        self._compute = compute
        self._recorder = recorder
        self._content = self._initial = content
        self._outputs = outputs
        self._changing = threading.Lock()
        """One change at a time: its outputs prepare before the session is locked. A re-arm does not
        wait for it."""
        self._holds = holds
        self._max_triangles = max_triangles
        self._acknowledged = content
        self.requests = requests or RequestLog(time.time_ns, time.monotonic_ns)
        self.keep_margins: Callable[[float, float, str], None] | None = None
        """Changes ``stop_mm`` and ``warn_mm`` for an origin, where `set_margins` is called for."""

    @property
    def compute(self) -> Compute:
        """Calls a function that computes for long, where it does not delay the session."""
        return self._compute

    @property
    def content(self) -> SessionContent:
        """The content in use."""
        return self._content

    @property
    def setup(self) -> SessionSetup:
        """The setup that the session steps with now; waits for a step that is being taken."""
        with self._between_steps() as session:
            return session.setup

    @property
    def requested(self) -> SessionSetup:
        """The setup in use, but with the margins that apply from the next re-arm on."""
        with self._between_steps() as session:
            return session.requested

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
            content = replace(self._content, margins=session.requested.margins)
            switches = self._prepare(content)
            session.rearm()
            self._holds.consume(seen)
            if content.margins != self._content.margins:
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

    def set_tumor(
        self,
        frame_from_tumor: Transform,
        tumor: SurfaceMesh,
        *,
        sigma_mm: float = 0.0,
        origin: str,
    ) -> str:
        """Use this tumour surface instead; returns its ``model_id``. Latches a hold.

        ``sigma_mm``: standard deviation of the surface along its normal, 0 where it is not stated.
        Raises `MeshError` for a surface that is not closed, `InputError` for one of too many
        triangles, and `FrameError` for another frame than the one that the tumour moves with,
        since that is what the session tracks.
        """
        with self._listed(RequestKind.TUMOR, origin) as done, self._changing:
            setup, shown = self.setup, self._acknowledged
            known = setup.frame_from_tumor
            if (frame_from_tumor.target, frame_from_tumor.source) != (known.target, known.source):
                raise FrameError(
                    f"tumour: given in frame {frame_from_tumor.target!r}; expected "
                    f"{known.target!r}, the frame that the session tracks it by"
                )
            check_size(tumor, self._max_triangles)
            if not 0.0 <= sigma_mm <= MAX_TUMOR_SIGMA_MM:
                raise InputError(
                    f"uncertainty of the tumour: is {sigma_mm:.6g} mm; expected 0 to "
                    f"{MAX_TUMOR_SIGMA_MM:g} mm"
                )
            new: dict[str, Any] = {
                "tumor": tumor,
                "tumor_accepted": True,
                "tumor_sigma_mm": sigma_mm,
            }
            content = replace(self._content, **new)
            # At once: the outputs are prepared in this process, the model usually in another one.
            with ThreadPoolExecutor(max_workers=1) as other_thread:
                preparing = other_thread.submit(self._prepare, content)
                proximity, change = replacement_for(
                    setup, shown, frame_from_tumor, tumor, self._compute
                )
                switches = preparing.result()
            if sigma_mm != shown.tumor_sigma_mm:
                change += f", uncertainty from {shown.tumor_sigma_mm:.2f} to {sigma_mm:.2f} mm"
            _ = content.model_id  # computed now, before the session waits for it
            with self._between_steps() as session:
                if shown is not self._acknowledged:
                    raise InputError(
                        "tumour: the session was re-armed while it was prepared; expected the "
                        "same request again"
                    )
                content = self._content.with_edge(frame_from_tumor, **new)
                setup = replace(content.setup(session.requested), proximity=proximity)
                self._apply(session, setup, content, switches, change)
            done.append(f"{self._content.model_id}, {change}")
        return self._content.model_id

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
            self._replace(registration.transform, robot=replace(robot, registration=registration))
            done.append(self._content.registration_id)
        return self._content.registration_id

    @property
    def recording(self) -> RecordingStatus | None:
        """State of the last recording of the session; None before the first."""
        return None if self._recorder is None else self._recorder.status

    def start_recording(self, name: str = "", *, origin: str) -> RecordingStatus:
        """Record the session as a new case called ``name``, or by date. Takes seconds.

        The case contains the tumour, tip, registration and margins in use now; those that are
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
            self._replace(tool_from_tip, tip_sigma_mm=sigma_mm)
            change = f"{tip_change_text(known, tool_from_tip)}, sigma {sigma_mm:.2f} mm"
            done.append(change if robot is None else f"{change}; register the robot again")

    def change_shown(self, kind: str, change: ShownChange, *, origin: str) -> None:
        """Change what is shown (`app.runtime.display_content`); state, constraint and hold stay.

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

    @contextmanager
    def _change_at_once(self, what: str, wait_s: float = _SHORT_WAIT_S) -> Iterator[None]:
        """Holds the lock of the changes; raises `InputError` if it is not free soon."""
        if not self._changing.acquire(timeout=wait_s):
            raise InputError(
                f"{what}: another change is being prepared; expected the same request again"
            )
        try:
            yield
        finally:
            self._changing.release()

    @contextmanager
    def _listed(self, kind: str, origin: str) -> Iterator[list[str]]:
        """List the request as accepted, with the texts added to the list, or as refused."""
        done: list[str] = []
        before = self._content
        try:
            yield done
        except Exception as error:
            self.requests.refused(kind, origin, str(error))
            raise
        if self._recorder is not None and self._content is not before:
            self._recorder.note_replaced(self._content.unpublished_changes(before))
            if self._content.image_depth != before.image_depth:
                self._recorder.note_depth()
        self.requests.accepted(kind, origin, "; ".join(done))

    def _replace(self, edge: Transform, **changes: Any) -> None:
        """Use ``edge`` and the ``changes`` of the content from the next step on."""
        switches = self._prepare(self._content.with_edge(edge, **changes))
        with self._between_steps() as session:
            content = self._content.with_edge(edge, **changes)
            self._apply(session, content.setup(session.requested), content, switches)

    def _prepare(self, content: SessionContent) -> list[SwitchContent]:
        return [output.prepare(content) for output in self._outputs]

    def _apply(
        self,
        session: Session,
        setup: SessionSetup,
        content: SessionContent,
        switches: list[SwitchContent],
        tumor_change: str = "",
    ) -> bool:
        """Change session and outputs; True if that latched a hold."""
        loosened = session.use(setup, tumor_change=tumor_change)
        self._switch(replace(content, margins=session.setup.margins), switches)
        if loosened:
            for output in self._outputs:
                output.latch(session.hold_causes)
        return loosened

    def _switch(self, content: SessionContent, switches: list[SwitchContent]) -> None:
        # The permissions of the last step were computed with the previous content.
        for output in self._outputs:
            output.revoke()
        for switch in switches:
            switch(content)
        self._content = content
