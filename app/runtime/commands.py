"""Changes of a running session by an operator, each between two steps, completely or not at all."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from app.fixture import MarginParameters, ProximityEngine, TipProximity
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.runtime.content import SessionContent
from app.runtime.outputs import Output, SwitchContent
from app.session import ProximityModel, Session, SessionSetup

BetweenSteps = Callable[[], AbstractContextManager[Session]]
"""Gives exclusive access to the session between two steps, as `LiveSession.between_steps` does."""


class OperatorCommands:
    """Re-arm a session, or replace its margins, its tumour or the registration of its robot.

    Slow work (distance field and surfaces of a new tumour) is done before the session is locked.
    A command that is refused raises before anything has changed.
    """

    def __init__(
        self, between_steps: BetweenSteps, content: SessionContent, outputs: Sequence[Output]
    ) -> None:
        self._between_steps = between_steps
        self._content = content
        self._outputs = outputs

    @property
    def content(self) -> SessionContent:
        """The content in use."""
        return self._content

    @property
    def setup(self) -> SessionSetup:
        """The setup that the session steps with now; waits for a step that is being taken."""
        with self._between_steps() as session:
            return session.setup

    def rearm(self, check: Callable[[], None]) -> None:
        """End the hold of an earlier fault.

        ``check`` is called between two steps and raises when the operator cannot have seen the
        present state. Raises `NotRearmableError` while the state is UNKNOWN.
        """
        with self._between_steps() as session:
            check()
            session.rearm()

    def set_margins(self, margins: MarginParameters) -> None:
        """Use ``margins`` from the next step on."""
        with self._between_steps() as session:
            content = replace(self._content, margins=margins)
            switches = self._prepare(content)
            self._apply(session, replace(session.setup, margins=margins), content, switches)

    def set_tumor(self, frame_from_tumor: Transform, tumor: SurfaceMesh) -> str:
        """Use this tumour surface instead; returns its ``model_id``.

        Raises `MeshError` for a surface that is not closed, and `FrameError` for another frame
        than the one that the tumour moves with, since that is what the session tracks.
        """
        setup = self.setup
        known = setup.frame_from_tumor
        if (frame_from_tumor.target, frame_from_tumor.source) != (known.target, known.source):
            raise FrameError(
                f"tumour: given in frame {frame_from_tumor.target!r}; expected {known.target!r}, "
                "the frame that the session tracks it by"
            )
        proximity = self._model(setup, tumor)
        switches = self._prepare(replace(self._content, tumor=tumor))
        with self._between_steps() as session:
            edges = self._edges(frame_from_tumor)
            self._apply(
                session,
                replace(session.setup, frame_from_tumor=frame_from_tumor, proximity=proximity),
                replace(self._content, tumor=tumor, static_edges=edges),
                switches,
            )
        return self._content.model_id

    def set_registration(self, registration: RegistrationResult) -> str:
        """Use this registration of the robot's base; returns its ``registration_id``.

        Raises `InputError` without a robot and for a registration that was not accepted, and
        `FrameError` for one between other frames.
        """
        if not registration.accepted:
            raise InputError(
                f"registration: not accepted, {registration.reason}; expected an accepted one"
            )
        with self._between_steps() as session:
            robot = session.setup.robot
            if robot is None:
                raise InputError("registration: the session has no robot; expected one")
            registered = replace(robot, registration=registration)
            edges = self._edges(registration.transform)
            content = replace(self._content, robot=registered, static_edges=edges)
            switches = self._prepare(content)
            self._apply(session, replace(session.setup, robot=registered), content, switches)
        return self._content.registration_id

    def _model(self, setup: SessionSetup, tumor: SurfaceMesh) -> ProximityModel:
        if isinstance(setup.proximity, TipProximity):
            return TipProximity(tumor)
        if self._content.tool is None:
            raise InputError(
                "tumour: cannot be replaced, because the tool's surface is unknown; expected a "
                "session with a tool mesh"
            )
        return ProximityEngine(tumor, self._content.tool)

    def _edges(self, changed: Transform) -> tuple[Transform, ...]:
        others = (edge for edge in self._content.static_edges if edge.source != changed.source)
        return (*others, changed)

    def _prepare(self, content: SessionContent) -> list[SwitchContent]:
        return [output.prepare(content) for output in self._outputs]

    def _apply(
        self,
        session: Session,
        setup: SessionSetup,
        content: SessionContent,
        switches: list[SwitchContent],
    ) -> None:
        session.use(setup)
        # The permissions of the last step were computed with the previous content.
        for output in self._outputs:
            output.revoke()
        for switch in switches:
            switch(content)
        self._content = content
