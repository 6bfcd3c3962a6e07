"""What stays the same during a replay: the fixed frames, the surfaces, the robot's description."""

import hashlib
from dataclasses import dataclass

from app.bridge.errors import BridgeError
from app.case import Case
from app.fixture import MarginParameters
from app.geometry import SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.robot import urdf_text
from app.session import SessionSetup


@dataclass(frozen=True, slots=True, eq=False)
class ReplayScene:
    """All that is published once, and latched.

    ``static_edges``: the calibrations and registrations of the session; two of them may not give
    the same child frame, which would tear the tree. ``tool`` is None when only its tip is known.
    ``robot_description`` is the text of a URDF, None without a robot. ``margins`` say for how long
    a constraint holds after the oldest sample that went in. ``registration``: that of the robot's
    base, with how sure it is.
    """

    static_edges: tuple[Transform, ...]
    tumor: SurfaceMesh
    tool: SurfaceMesh | None
    margins: MarginParameters
    robot_description: str | None = None
    registration: RegistrationResult | None = None

    def __post_init__(self) -> None:
        children = [edge.source for edge in self.static_edges]
        for child in children:
            if children.count(child) > 1:
                raise BridgeError(f"frame {child!r} has {children.count(child)} parents: 1 allowed")

    @property
    def model_id(self) -> str:
        """A name for the tumour's surface that changes with any of its numbers."""
        return _digest(self.tumor.vertices_mm.tobytes() + self.tumor.faces.tobytes())

    @property
    def registration_id(self) -> str:
        """A name for the registration of the robot; empty when there is none."""
        return (
            ""
            if self.registration is None
            else _digest(self.registration.transform.matrix.tobytes())
        )


def scene_of(
    case: Case, setup: SessionSetup, *, tip_only: bool, with_robot: bool = True
) -> ReplayScene:
    """What stays the same in a session of ``case``.

    ``with_robot``: the robot's description is ours to publish.
    """
    robot = setup.robot
    return ReplayScene(
        static_edges=(
            *setup.static_edges,
            *(root_edges(robot.base_frame, robot.robot.root_link) if robot else ()),
        ),
        tumor=case.tumor_mesh(),
        tool=None if tip_only else case.tool_mesh(),
        margins=setup.margins,
        robot_description=(
            urdf_text(case.robot_urdf(), package_dirs=case.package_dirs)
            if robot and with_robot
            else None
        ),
        registration=robot.registration if robot else None,
    )


def root_edges(base_frame: str, root_link: str) -> tuple[Transform, ...]:
    """The edge from the registered base to the URDF's root: two names of one place, or one."""
    if base_frame == root_link:
        return ()
    return (Transform.identity(base_frame, root_link),)


def _digest(data: bytes) -> str:
    return f"sha256:{hashlib.sha256(data).hexdigest()[:16]}"
