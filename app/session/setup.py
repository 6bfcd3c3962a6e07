"""Setup of a session: everything that is fixed before its first step."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from app.case import PlausibilityEntry
from app.fixture import MarginParameters, Proximity, SweptProximity, TumorMotionParameters
from app.geometry import FrameError, InputError, Stamp, Transform
from app.registration import DriftBound, RegistrationResult
from app.robot import Robot
from app.session.tracking_error import NO_ERROR, TrackingError

REFERENCE = "reference"
"""The frame of the sensor on the patient, to which the robot's base is registered."""


class ProximityModel(Protocol):
    """Measures the distance of a tool from a tumour: the whole mesh, or its tip alone.

    No part of the tool is further than ``radius_mm`` from its origin.
    """

    radius_mm: float

    @property
    def frames(self) -> tuple[str, str | None]:
        """Frames of the tumour and of the tool; None for a tool that is valid in any frame."""

    def evaluate(self, tumor_from_tool: Transform, stamp: Stamp | None = None) -> Proximity:
        """Signed distance in mm of the tool at this pose, negative inside the tumour."""

    def sweep(
        self, previous: Transform, current: Transform, stamp: Stamp | None = None
    ) -> SweptProximity:
        """Lowest signed distance in mm on the path from one pose to the next."""

    def add_free_motion(self, proximity: Proximity, tumor_from_tool: Transform) -> Proximity:
        """``proximity``, which is that of the pose, with its free motion."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotSetup:
    """A robot whose base frame ``base_frame`` is the root link of ``robot``.

    The tip of the tool is the origin of ``tool_link``. ``registration`` is
    ``reference_from_<base_frame>``, None while it is not registered. ``link_from_tip`` holds the
    orientation of the tool in the link, None if only the position is known. ``max_drift``: largest
    allowed distance of the tracked tool from its prediction. ``follows_tool``: no joints were
    recorded, and the robot is posed by inverse kinematics. Raises `FrameError` for an unknown
    ``tool_link`` and for a registration of other frames.
    """

    robot: Robot
    base_frame: str
    tool_link: str
    registration: RegistrationResult | None
    max_drift: DriftBound
    link_from_tip: Transform | None = None
    follows_tool: bool = False

    def __post_init__(self) -> None:
        links = {link.name for link in self.robot.links}
        if self.tool_link not in links:
            raise FrameError(
                f"robot.tool_link {self.tool_link!r} is not a link of {self.robot.name!r}; "
                f"expected one of {', '.join(sorted(links))}"
            )
        if self.registration is not None:
            transform = self.registration.transform
            if (transform.target, transform.source) != (REFERENCE, self.base_frame):
                raise FrameError(
                    f"registration is {transform.target}_from_{transform.source}; "
                    f"expected {REFERENCE}_from_{self.base_frame}"
                )
        # Compiles the kinematics, so that the first step does not wait for it.
        self.robot.forward_kinematics({})

    @property
    def joint_names(self) -> frozenset[str]:
        """The joints that move ``tool_link``."""
        return self.robot.joints_that_move(self.tool_link)

    def is_posed_by(self, joint_names: Iterable[str]) -> bool:
        """True if positions of these joints determine the pose of ``tool_link``.

        It is False for those of another device on the same topic, such as a gripper.
        """
        return self.robot.is_determined(self.tool_link, frozenset(joint_names))


@dataclass(frozen=True, slots=True, eq=False)
class SessionSetup:
    """The fixed part of a session.

    ``tool_from_tip``: the tip in the tool's tracked frame. ``frame_from_tumor``: the tumour in the
    tracked frame that it moves with. ``proximity``: distance model of the tool, given in the tip's
    frame, and the tumour. ``robot``: None for a hand-held tool. ``tumor_motion``: parameters of
    the tumour's motion, for a constraint that contains its velocity; None for a still tumour.
    ``motion_frame`` is the measured frame that it is relative to, None for the reference.
    ``plausibility``: limits and relations by which a wrong pose is found. ``tracking``: latency and
    errors of the tracker, for the margin. ``tumor_sigma_mm``: standard deviation of the tumour's
    surface along its normal, ``tip_sigma_mm`` that of the calibrated tip in its worst direction; 0
    where they are not stated. ``shown_frames``: tracked frames of needle and stylus, which no
    decision uses.

    Raises `FrameError` for shapes in other frames than those of the two transforms, and for a
    robot's base with the name of another frame, which would be a loop, and for a link of the robot
    with that of a shown frame. Raises `InputError` for a
    moving tumour without a robot or a ``motion_frame``: nothing would use the velocity.
    """

    tool_from_tip: Transform
    frame_from_tumor: Transform
    proximity: ProximityModel
    margins: MarginParameters
    robot: RobotSetup | None
    tumor_motion: TumorMotionParameters | None = None
    plausibility: PlausibilityEntry = field(default_factory=PlausibilityEntry)
    motion_frame: str | None = None
    tracking: TrackingError = NO_ERROR
    tumor_sigma_mm: float = 0.0
    tip_sigma_mm: float = 0.0
    shown_frames: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.tumor_motion is not None and self.robot is None and self.motion_frame is None:
            raise InputError(
                "tumor_motion is given without a robot: nothing uses the velocity; expected a "
                "robot, or the frame that is at rest beside the controller's"
            )
        tumor, tool = self.proximity.frames
        for what, frame, edge in (
            ("tumour", tumor, self.frame_from_tumor),
            ("tool", tool, self.tool_from_tip),
        ):
            if frame is not None and frame != edge.source:
                raise FrameError(
                    f"the {what}'s shape is in {frame!r}; expected {edge.source!r}, which is "
                    f"placed in {edge.target!r}"
                )
        edges = (self.tool_from_tip, self.frame_from_tumor)
        others = {REFERENCE, *(name for edge in edges for name in (edge.target, edge.source))}
        if self.robot is not None and self.robot.base_frame in others:
            raise FrameError(
                f"robot.base_frame is {self.robot.base_frame!r}; expected a name of its own, "
                f"not one of the other frames {', '.join(sorted(others))}"
            )
        links = set() if self.robot is None else {link.name for link in self.robot.robot.links}
        for frame in links.intersection(self.shown_frames):
            raise FrameError(
                f"the tracked frame {frame!r} of needle or stylus is also a link of the robot; "
                "expected another name"
            )

    @property
    def static_edges(self) -> tuple[Transform, ...]:
        """Transforms that do not change during the session, as static tf edges."""
        registered = (
            (self.robot.registration.transform,)
            if self.robot is not None and self.robot.registration is not None
            else ()
        )
        return (self.tool_from_tip, self.frame_from_tumor, *registered)

    @property
    def measured_ends(self) -> tuple[tuple[str, str], ...]:
        """Pairs of frames whose relative poses the session needs from the tracker."""
        tool = self.tool_from_tip.target
        ends = [(self.frame_from_tumor.target, tool)]
        if self.robot is not None:
            ends.append((REFERENCE, tool))
        if self.tumor_motion is not None and self.motion_frame is not None:
            ends.append((self.motion_frame, self.frame_from_tumor.target))
        base = None if self.robot is None else self.robot.base_frame
        for target, source in self.plausibility.ends(tool):
            ends.append((REFERENCE if target == base else target, source))
        return tuple(dict.fromkeys(ends))
