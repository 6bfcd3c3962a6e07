"""Changes of a running session, each between two steps, whole or not at all."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

from app.bridge.errors import BridgeError
from app.bridge.publishing.prepared_shapes import PreparedShapes
from app.bridge.publishing.replay_scene import ReplayScene
from app.fixture import MarginParameters, ProximityEngine, TipProximity
from app.geometry import SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.session import ProximityModel, Session, SessionSetup

BetweenSteps = Callable[[], AbstractContextManager[Session]]
"""Gives the session while nobody takes a step: `LiveSession.between_steps` is one."""


class ShowsScene(Protocol):
    """What publishes the session: `SessionPublisher` is one."""

    def use(self, scene: ReplayScene, shapes: PreparedShapes | None = None) -> None:
        """Go on with this scene from the next step on; ``shapes`` are new surfaces of it."""


class SessionChanges:
    """Gives new margins, a new tumour or a new registration to a session and to its publisher.

    What is slow (fields and surfaces of a new tumour) is done before the session is held up; what
    is refused is refused before anything is changed.
    """

    def __init__(
        self, between_steps: BetweenSteps, publisher: ShowsScene, scene: ReplayScene
    ) -> None:
        self._between_steps = between_steps
        self._publisher = publisher
        self._scene = scene

    @property
    def scene(self) -> ReplayScene:
        """What is published now."""
        return self._scene

    @property
    def setup(self) -> SessionSetup:
        """What the session steps with now."""
        with self._between_steps() as session:
            return session.setup

    def set_margins(self, margins: MarginParameters) -> None:
        """Keep these margins from the next step on."""
        with self._between_steps() as session:
            self._go_on(
                session,
                replace(session.setup, margins=margins),
                replace(self._scene, margins=margins),
            )

    def set_tumor(self, frame_from_tumor: Transform, tumor: SurfaceMesh) -> str:
        """Guard this surface instead; its `model_id`.

        Raises `MeshError` for one that is not sound, and `BridgeError` for another frame than
        that which the tumour moves with now, since that is what the session tracks.
        """
        setup = self.setup
        known = setup.frame_from_tumor
        if (frame_from_tumor.target, frame_from_tumor.source) != (known.target, known.source):
            raise BridgeError(
                f"the tumour is given in {frame_from_tumor.target!r}: the session tracks it by "
                f"{known.target!r}"
            )
        proximity = self._model(setup, tumor)
        shapes = PreparedShapes(replace(self._scene, tumor=tumor))
        with self._between_steps() as session:
            self._go_on(
                session,
                replace(session.setup, frame_from_tumor=frame_from_tumor, proximity=proximity),
                replace(self._scene, tumor=tumor, static_edges=self._edges(frame_from_tumor)),
                shapes,
            )
        return self._scene.model_id

    def set_registration(self, registration: RegistrationResult) -> str:
        """Use this registration of the robot's base; its `registration_id`.

        Raises `BridgeError` without a robot and for a refused registration, and `FrameError` for
        one between other frames.
        """
        if not registration.accepted:
            raise BridgeError(f"the registration is refused: {registration.reason}")
        with self._between_steps() as session:
            robot = session.setup.robot
            if robot is None:
                raise BridgeError("the session has no robot whose base could be registered")
            transform = registration.transform
            self._go_on(
                session,
                replace(session.setup, robot=replace(robot, registration=registration)),
                replace(
                    self._scene, registration=registration, static_edges=self._edges(transform)
                ),
            )
        return self._scene.registration_id

    def _model(self, setup: SessionSetup, tumor: SurfaceMesh) -> ProximityModel:
        if isinstance(setup.proximity, TipProximity):
            return TipProximity(tumor)
        if self._scene.tool is None:
            raise BridgeError("the tool's surface is not known: the tumour cannot be replaced")
        return ProximityEngine(tumor, self._scene.tool)

    def _edges(self, changed: Transform) -> tuple[Transform, ...]:
        kept = (edge for edge in self._scene.static_edges if edge.source != changed.source)
        return (*kept, changed)

    def _go_on(
        self,
        session: Session,
        setup: SessionSetup,
        scene: ReplayScene,
        shapes: PreparedShapes | None = None,
    ) -> None:
        session.use(setup)
        self._publisher.use(scene, shapes)
        self._scene = scene
