"""Guidance along a planned corridor: where the needle is, and where it will arrive."""

import math
from dataclasses import dataclass

import numpy as np

from app.fixture.control.half_spaces import plane_axes
from app.geometry import FloatArray, FrameError, InputError, Transform
from app.planning.needle_places import points_of
from app.planning.needle_values import MAX_ANGLE_RAD

PATH_FRAME = "needle_path"

_AXIS_TOLERANCE = 1e-6
"""Maximum deviation of the length of the needle's axis from 1."""


@dataclass(frozen=True, slots=True, eq=False)
class NeedlePath:
    """The straight way from ``entry_mm`` (3,) at the skin to ``target_mm`` (3,), in ``frame``.

    Raises `InputError` for points that are not finite or coincide.

    >>> import marginguard as mg
    >>> mg.NeedlePath("ct", [0, 0, 80], [0, 0, 0]).depth_mm
    80.0
    """

    frame: str
    entry_mm: FloatArray
    target_mm: FloatArray

    def __post_init__(self) -> None:
        for name in ("entry_mm", "target_mm"):
            object.__setattr__(self, name, points_of([getattr(self, name)], name)[0])
        if not self.depth_mm > 0.0:
            raise InputError("path: entry and target are one point; expected two points")

    @property
    def depth_mm(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(self.target_mm - self.entry_mm))

    @property
    def frame_from_path(self) -> Transform:
        """The axes of the path: z to the target, x and y across it, the origin at the entry."""
        axes = plane_axes((self.target_mm - self.entry_mm) / self.depth_mm, None)
        return Transform(self.frame, PATH_FRAME, axes, self.entry_mm)

    def in_frame(self, target_from_frame: Transform) -> "NeedlePath":
        """The path in another frame, such as that of a constraint."""
        if target_from_frame.source != self.frame:
            raise FrameError(
                f"pose of the path's frame: is from {target_from_frame.source!r}; "
                f"expected from {self.frame!r}"
            )
        ends = target_from_frame.apply(np.stack([self.entry_mm, self.target_mm]))
        return NeedlePath(target_from_frame.target, *ends)

    def path_from_needle(self, frame_from_needle: Transform) -> tuple[FloatArray, FloatArray]:
        """Tip (3,) in mm and axis (3,) from the hub to the tip, in the axes of the path.

        The needle's frame has its origin at the tip, and +z points from the hub to the tip.
        Raises `FrameError` for a pose in another frame, and `InputError` for one that is not finite
        or no rigid transform.
        """
        if frame_from_needle.target != self.frame:
            raise FrameError(
                f"needle: is in {frame_from_needle.target!r}; expected {self.frame!r} as the path"
            )
        tip, axis = frame_from_needle.translation_mm, frame_from_needle.rotation[:, 2]
        length = float(np.linalg.norm(axis))
        # Also for NaN.
        if not (np.isfinite(tip).all() and abs(length - 1.0) <= _AXIS_TOLERANCE):
            raise InputError(
                f"needle: tip is {tip.tolist()} and axis {axis.tolist()}; expected finite numbers "
                "and an axis of length 1"
            )
        axes = self.frame_from_path.inverse()
        return axes.apply(tip), axes.rotate(axis)

    def is_target_near(self, target_mm: FloatArray | None, window_mm: float) -> bool:
        """True if the target is at most ``window_mm`` from its planned place.

        ``target_mm`` (3,) is its place now, in the path's frame, None if that is not known: then
        the result is False. Gates the advance of a needle by the breath. Raises `InputError` for a
        place or a window that is not finite.
        """
        if not (math.isfinite(window_mm) and window_mm >= 0.0):
            raise InputError(f"window: is {window_mm} mm; expected 0 mm or more")
        if target_mm is None:
            return False
        moved_mm = points_of([target_mm], "place of the target")[0] - self.target_mm
        return float(np.linalg.norm(moved_mm)) <= window_mm


@dataclass(frozen=True, slots=True, eq=False)
class NeedleGuidance:
    """Errors of a needle on its path.

    ``lateral_mm``: distance of the tip from the path's axis. ``angle_rad``: between the axes of
    needle and path. ``remaining_mm``: depth from the tip to the target along the path, negative
    beyond it. ``miss_mm``: distance from the target at which the needle arrives in the target's
    plane if it is pushed straight on. ``crosshair_mm`` (2,): where the needle's axis meets the
    plane of the entry, along x and y of the path's axes (`NeedlePath.frame_from_path`). Both planes
    are perpendicular to the path.
    """

    lateral_mm: float
    angle_rad: float
    remaining_mm: float
    miss_mm: float
    crosshair_mm: FloatArray


def guide_needle(path: NeedlePath, frame_from_needle: Transform) -> NeedleGuidance:
    """Errors of the needle at ``frame_from_needle``: origin at the tip, +z from hub to tip.

    Raises `FrameError` for a pose in another frame than the path's, and `InputError` for one that
    is not finite and for a needle that is more than 60 degrees from the path.

    >>> import marginguard as mg
    >>> path = mg.NeedlePath("ct", [0, 0, 0], [0, 0, 80])
    >>> needle = mg.Transform("ct", "needle", [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [3, 4, 20])
    >>> found: mg.NeedleGuidance = mg.guide_needle(path, needle)
    >>> found.lateral_mm, found.angle_rad, found.remaining_mm, found.miss_mm
    (5.0, 0.0, 60.0, 5.0)
    """
    tip, axis = path.path_from_needle(frame_from_needle)
    angle_rad = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    if angle_rad > MAX_ANGLE_RAD:
        raise InputError(
            f"needle: is {math.degrees(angle_rad):.0f} degrees from the path; "
            f"expected at most {math.degrees(MAX_ANGLE_RAD):.0f}"
        )
    slope = axis[:2] / axis[2]
    remaining_mm = path.depth_mm - float(tip[2])
    crosshair_mm = tip[:2] - tip[2] * slope
    crosshair_mm.flags.writeable = False
    return NeedleGuidance(
        math.hypot(tip[0], tip[1]),
        angle_rad,
        remaining_mm,
        float(np.linalg.norm(tip[:2] + remaining_mm * slope)),
        crosshair_mm,
    )
