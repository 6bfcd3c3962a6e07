"""What stands on the stage, the same until somebody changes the session."""

from dataclasses import dataclass
from typing import Self

from app.fixture import margin_surface
from app.geometry import SurfaceMesh, Transform
from app.registration import RegistrationResult
from app.robot import Robot
from app.session import SessionSetup

_SPACING_MM = 1.0
"""Of the margin's surface, which is looked at through and drawn many times a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Cast:
    """Shapes and fixed places; two casts are the same when they are one object.

    ``tumor`` in the frame "tumor", ``margin`` in the same: None shows none. ``tool`` in its tip's
    frame ``tip_frame``: None shows the tip alone. ``fixed``: the calibrations and the registration.
    ``robot`` stands at ``base_frame``, as ``registration`` says; ``tool_link`` holds the tool.
    """

    tumor: SurfaceMesh
    margin: SurfaceMesh | None
    tool: SurfaceMesh | None
    tip_frame: str
    fixed: tuple[Transform, ...]
    robot: Robot | None = None
    base_frame: str = ""
    tool_link: str = ""
    registration: RegistrationResult | None = None

    @classmethod
    def of(cls, setup: SessionSetup, tumor: SurfaceMesh, tool: SurfaceMesh | None) -> Self:
        """That of a session; ``tumor`` and ``tool`` are what it measures, None for a tip alone."""
        robot = setup.robot
        return cls(
            tumor=tumor,
            margin=stop_surface(tumor, setup.margins.stop_mm),
            tool=tool,
            tip_frame=setup.tool_from_tip.source,
            fixed=setup.static_edges,
            robot=None if robot is None else robot.robot,
            base_frame="" if robot is None else robot.base_frame,
            tool_link="" if robot is None else robot.tool_link,
            registration=None if robot is None else robot.registration,
        )


def stop_surface(tumor: SurfaceMesh, stop_mm: float) -> SurfaceMesh | None:
    """The surface at the stop margin as it is set; None for a margin of 0. Takes a moment."""
    return margin_surface(tumor, stop_mm, spacing_mm=_SPACING_MM) if stop_mm > 0.0 else None
