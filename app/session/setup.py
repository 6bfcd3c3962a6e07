"""Setup of a session: everything that is fixed before its first step."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from app.case import DISPLAY_ITEMS, PlausibilityEntry, TrackingFrame
from app.fixture import (
    GuidanceParameters,
    LimiterParameters,
    MarginParameters,
    Proximity,
    TumorMotionParameters,
)
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    TrackedTransform,
    Transform,
)
from app.registration import DriftBound, RegistrationResult
from app.robot import Robot
from app.session.structure import ProximityModel, Role, Structure

if TYPE_CHECKING:
    from app.case import LiveCase  # slow

REFERENCE = "reference"
"""The frame of the sensor on the patient, to which the robot's base is registered."""


@dataclass(frozen=True, slots=True)
class TrackingError:
    """Errors of a tracker as its user knows them, from a data sheet or a measurement.

    ``latency_ns``: from the acquisition of a pose to its stamp, which a driver that stamps on
    arrival hides. ``sigma_mm`` and ``sigma_rad``: standard deviation of a pose along and about each
    axis, of errors that stay for seconds, too. Raises `InputError` for values below 0.

    >>> TrackingError(sigma_mm=0.3).sigma_between(0.0, 0.0)
    0.4242640687119285
    """

    latency_ns: int = 0
    sigma_mm: float = 0.0
    sigma_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} of the tracker is {value}; expected 0 or more")

    def acquired(self, frame: TrackingFrame) -> TrackingFrame:
        """``frame`` with the acquisition of each pose as its stamp.

        The age of a pose is then its true one: in the margin ``v_max_mm_s`` times the age, in the
        limit for stale poses and in the prediction of the tumour's motion. A stamp after the
        frame's stays as it is, because it is wrong and has to be found.
        """
        if not self.latency_ns:
            return frame
        return TrackingFrame(
            frame.stamp,
            tuple(self._acquired(each, frame) for each in frame.poses),
            frame.joints,
            activation=frame.activation,
        )

    def _acquired(self, sample: TrackedTransform, frame: TrackingFrame) -> TrackedTransform:
        if sample.stamp.ns > frame.stamp.ns:
            return sample
        return replace(sample, stamp=sample.stamp.shifted(-self.latency_ns, sample.stamp.clock))

    def sigma_between(self, tool_lever_mm: float, tumor_lever_mm: float) -> float:
        """Standard deviation in mm, along any axis, of a tool point beside a tumour point.

        The points are that far from the origins of the measured frames of tool and tumour. A pose
        that is wrong by the translation t and the rotation vector r moves a point at p by t + r x
        p; for independent errors along and about the axes its variance along an axis is at most
        ``sigma_mm**2 + sigma_rad**2 |p|**2`` (the propagation of a marker frame's error to the
        tip: West and Maurer, Designing Optically Tracked Instruments for Image-Guided Surgery,
        IEEE TMI 23, 2004). The errors of tool and tumour are independent, so variances add up.
        """
        return math.sqrt(
            2.0 * self.sigma_mm**2 + self.sigma_rad**2 * (tool_lever_mm**2 + tumor_lever_mm**2)
        )

    @property
    def is_known(self) -> bool:
        """True if an error of the poses is stated."""
        return bool(self.sigma_mm or self.sigma_rad)

    def sigma_of(
        self, proximity: Proximity, tumor_from_tool: Transform, tumor_from_frame: Transform
    ) -> float:
        """`sigma_between` at the witness of ``proximity`` where it is largest, in mm.

        ``tumor_from_tool`` and ``tumor_from_frame`` are the measured frames of tool and tumour in
        the tumour's.
        """
        points = proximity.witnesses.on_tool_mm
        return self.sigma_between(
            _lever_mm(points, tumor_from_tool), _lever_mm(points, tumor_from_frame)
        )


NO_ERROR = TrackingError()
"""Errors of a tracker about which nothing is known: the margin has no term for them."""


def _lever_mm(points: FloatArray, frame: Transform) -> float:
    """Largest distance of ``points`` (k, 3) from the origin of ``frame``."""
    return float(np.linalg.norm(points - frame.translation_mm, axis=1).max())


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
class OtherTool:
    """A further tool, which another session guards: up to ``warn_mm`` its distance is a warning.

    ``tool_from_tip``: its tip in its tracked frame. ``proximity``: distance model of the guarded
    tool and this one, whose shape is in the frame of its tip.
    """

    name: str
    tool_from_tip: Transform
    proximity: ProximityModel
    warn_mm: float


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
    where they are not stated. ``shown_frames``: tracked frames of display items and other tools,
    which no decision uses. ``structures``: further structures; the tumour is the first of
    `guarded`, and its frame is that of the constraint. ``off``: structures that an operator has
    switched off, each with the reason; they are not among ``structures``. ``other_tools``: those
    whose distance from the tool is measured; ``tool_names`` are the names of all others.

    Raises `FrameError` for shapes in other frames than those of the two transforms, and for a
    robot's base with the name of another frame, which would be a loop, and for a link of the robot
    with that of a shown frame, for two structures of one name, and for a robot's ``link_from_tip``
    between frames that are not its ``tool_link`` and the tip. Raises `InputError` for a moving
    tumour without a robot or a ``motion_frame``: nothing would use the velocity, and
    `MarginParameterError` for distances of a structure that are no margins.
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
    structures: tuple[Structure, ...] = ()
    off: Mapping[str, str] = field(default_factory=dict)
    other_tools: tuple[OtherTool, ...] = ()
    tool_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.tumor_motion is not None and self.robot is None and self.motion_frame is None:
            raise InputError(
                "tumor_motion is given without a robot: nothing uses the velocity; expected a "
                "robot, or the frame that is at rest beside the controller's"
            )
        for each in self.structures:
            each.margins(self.margins)  # raises
        for what, frame, edge in (
            *(
                (_called(each, self.guarded), each.proximity.frames[0], each.frame_from_structure)
                for each in self.guarded
            ),
            *(
                (f"tool {each.name!r}", each.proximity.frames[0], each.tool_from_tip)
                for each in self.other_tools
            ),
            *(("tool", each.proximity.frames[1], self.tool_from_tip) for each in self.guarded),
            *(("tool", each.proximity.frames[1], self.tool_from_tip) for each in self.other_tools),
        ):
            if frame is not None and frame != edge.source:
                raise FrameError(
                    f"the {what}'s shape is in {frame!r}; expected {edge.source!r}, which is "
                    f"placed in {edge.target!r}"
                )
        tips = (self.tool_from_tip, *(each.tool_from_tip for each in self.other_tools))
        edges = (*tips, *(each.frame_from_structure for each in self.guarded))
        names = [edge.source for edge in edges]
        for name in names:
            if names.count(name) > 1:
                raise FrameError(
                    f"structures: {names.count(name)} shapes are named {name!r}; expected a name "
                    "of its own for each"
                )
        others = {REFERENCE, *(name for edge in edges for name in (edge.target, edge.source))}
        if self.robot is not None and self.robot.base_frame in others:
            raise FrameError(
                f"robot.base_frame is {self.robot.base_frame!r}; expected a name of its own, "
                f"not one of the other frames {', '.join(sorted(others))}"
            )
        mount = None if self.robot is None else self.robot.link_from_tip
        if self.robot is not None and mount is not None:
            ends = self.robot.tool_link, self.tool_from_tip.source
            if ends != (mount.target, mount.source):
                found, expected = f"{mount.target}_from_{mount.source}", "_from_".join(ends)
                raise FrameError(f"link_from_tip: is {found}; expected {expected}")
        links = set() if self.robot is None else {link.name for link in self.robot.robot.links}
        for frame in links.intersection(self.shown_frames):
            items = ", ".join(each.name for each in DISPLAY_ITEMS)
            raise FrameError(
                f"the tracked frame {frame!r} of {items} or another tool is also a "
                "link of the robot; expected another name"
            )
        for structure in self.structures:
            if structure.name in links:
                raise FrameError(
                    f"structure {structure.name!r} has the name of a link of the robot; "
                    "expected another name"
                )

    @property
    def guarded(self) -> tuple[Structure, ...]:
        """The tumour, which is the first target, and the further structures."""
        tumor = Structure(
            self.frame_from_tumor,
            self.proximity,
            self.margins.stop_mm,
            self.margins.warn_mm,
            self.tumor_sigma_mm,
            Role.TARGET,
        )
        return (tumor, *self.structures)

    @property
    def moving_frames(self) -> tuple[str, ...]:
        """Frames with sensors: those of tool and structures, and with a robot the reference."""
        structures = (each.frame_from_structure.target for each in self.guarded)
        moving = dict.fromkeys((self.tool_from_tip.target, *structures))
        return tuple(moving if self.robot is None else moving | {REFERENCE: None})

    @property
    def static_edges(self) -> tuple[Transform, ...]:
        """Transforms that do not change during the session, as static tf edges."""
        registered = (
            (self.robot.registration.transform,)
            if self.robot is not None and self.robot.registration is not None
            else ()
        )
        placed = (each.frame_from_structure for each in self.guarded)
        return (self.tool_from_tip, *placed, *registered)

    @property
    def measured_ends(self) -> tuple[tuple[str, str], ...]:
        """Pairs of frames whose relative poses the session needs from the tracker."""
        tool = self.tool_from_tip.target
        ends = [(each.frame_from_structure.target, tool) for each in self.guarded]
        if self.robot is not None:
            ends.append((REFERENCE, tool))
        if self.tumor_motion is not None and self.motion_frame is not None:
            frames = (each.frame_from_structure.target for each in self.guarded)
            ends += [(self.motion_frame, frame) for frame in frames if frame != self.motion_frame]
        base = None if self.robot is None else self.robot.base_frame
        for target, source in self.plausibility.ends(tool):
            ends.append((REFERENCE if target == base else target, source))
        return tuple(dict.fromkeys(ends))


def _called(structure: Structure, guarded: tuple[Structure, ...]) -> str:
    return "tumour" if structure.name == guarded[0].name else f"structure {structure.name!r}"


def guidance_parameters(live: "LiveCase") -> GuidanceParameters | None:
    """Parameters of ``guidance``, None without it; raises `InputError` if not passive."""
    if live.guidance is None:
        return None
    try:
        return GuidanceParameters(**live.guidance)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: guidance: {error}") from error


def limiter_parameters(live: "LiveCase") -> LimiterParameters:
    """Parameters of ``limiter``; values that are not given keep their defaults."""
    try:
        return LimiterParameters(**live.limiter)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: limiter: {error}") from error


def tumor_motion_parameters(live: "LiveCase") -> TumorMotionParameters | None:
    """Parameters of ``tumor_motion``, None without it."""
    if live.tumor_motion is None:
        return None
    try:
        return TumorMotionParameters(**live.tumor_motion)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: tumor_motion: {error}") from error
