"""What stays the same during a replay: the fixed frames, the surfaces, the robot's description."""

import hashlib
from dataclasses import dataclass

from app.bridge.errors import BridgeError
from app.fixture import MarginParameters
from app.geometry import SurfaceMesh, Transform


@dataclass(frozen=True, slots=True, eq=False)
class ReplayScene:
    """All that is published once, and latched.

    ``static_edges``: the calibrations and registrations of the session; two of them may not give
    the same child frame, which would tear the tree. ``tool`` is None when only its tip is known.
    ``robot_description`` is the text of a URDF, None without a robot. ``margins`` say for how long
    a constraint holds after the oldest sample that went in.
    """

    static_edges: tuple[Transform, ...]
    tumor: SurfaceMesh
    tool: SurfaceMesh | None
    margins: MarginParameters
    robot_description: str | None = None
    registration: Transform | None = None

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
        return "" if self.registration is None else _digest(self.registration.matrix.tobytes())


def root_edges(base_frame: str, root_link: str) -> tuple[Transform, ...]:
    """The edge from the registered base to the URDF's root: two names of one place, or one."""
    if base_frame == root_link:
        return ()
    return (Transform.identity(base_frame, root_link),)


def _digest(data: bytes) -> str:
    return f"sha256:{hashlib.sha256(data).hexdigest()[:16]}"
