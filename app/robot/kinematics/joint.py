"""Joints as a URDF tells them: how a child link moves in its parent."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from app.geometry import FloatArray, Transform
from app.robot.errors import UrdfError

MM_PER_M = 1000.0


class JointType(StrEnum):
    """The joint types that have kinematics here: at most one degree of freedom each.

    ``floating`` and ``planar`` joints are refused, because a single number cannot place them and
    a link shown at a made-up place is worse than none.
    """

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class Mimic:
    """``position = multiplier * leader's position + offset``, in rad, or in m if sliding."""

    leader: str
    multiplier: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("multiplier", "offset"):
            if not math.isfinite(getattr(self, name)):
                raise UrdfError(
                    f"{name} of the mimic of {self.leader!r} is {getattr(self, name)}: "
                    "a finite number wanted"
                )


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """``child`` hangs on ``parent``: origin, then the motion about or along ``axis``.

    ``origin`` is ``parent_from_child`` at position 0. ``axis`` is (3,), a unit vector in the
    child's frame, and ``pivot_mm`` (3,) a point of it, there as well: the origin in URDF, anywhere
    in AMBF. ``lower`` and ``upper`` are rad, m for sliding joints, and infinite for continuous
    ones; kinematics does not clip to them, inverse kinematics stays within them.
    """

    name: str
    type: JointType
    origin: Transform
    axis: FloatArray
    lower: float = -math.inf
    upper: float = math.inf
    mimic: Mimic | None = None
    pivot_mm: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        axis = np.array(self.axis, dtype=np.float64)
        if axis.shape != (3,) or not np.isfinite(axis).all():
            raise UrdfError(f"axis of joint {self.name!r} is {axis.tolist()}: 3 numbers wanted")
        length = float(np.linalg.norm(axis))
        if self.type is not JointType.FIXED:
            if length < 1e-9:
                raise UrdfError(
                    f"axis of joint {self.name!r} is {axis.tolist()}: a direction wanted"
                )
            axis /= length
        # Written so that NaN limits are refused as well.
        if not self.lower <= self.upper:
            raise UrdfError(
                f"limits of joint {self.name!r} are {self.lower} to {self.upper}: "
                "lower <= upper wanted"
            )
        pivot_mm = np.array(self.pivot_mm, dtype=np.float64)
        if pivot_mm.shape != (3,) or not np.isfinite(pivot_mm).all():
            raise UrdfError(
                f"pivot of joint {self.name!r} is {pivot_mm.tolist()} mm: 3 numbers wanted"
            )
        axis.flags.writeable = pivot_mm.flags.writeable = False
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "pivot_mm", pivot_mm)

    @property
    def parent(self) -> str:
        """The link that the joint hangs on."""
        return self.origin.target

    @property
    def child(self) -> str:
        """The link that the joint moves."""
        return self.origin.source

    @property
    def moves(self) -> bool:
        """False for a fixed joint."""
        return self.type is not JointType.FIXED

    @property
    def slides(self) -> bool:
        """True where the position is a length (m) and not an angle (rad)."""
        return self.type is JointType.PRISMATIC

    @property
    def twist(self) -> FloatArray:
        """T (4, 4) of the motion ``I + a T + b T^2`` of the child from its place at 0, in mm.

        A turn by q has a = sin q, b = 1 - cos q (Rodrigues; Murray, Li and Sastry, A Mathematical
        Introduction to Robotic Manipulation, 1994, equation 2.36); a slide by q metres has a = q,
        and T^2 is 0. A fixed joint's is 0.
        """
        twist = np.zeros((4, 4))
        if self.slides:
            twist[:3, 3] = MM_PER_M * self.axis
        elif self.moves:
            x, y, z = self.axis.tolist()
            twist[:3, :3] = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
            twist[:3, 3] = -twist[:3, :3] @ self.pivot_mm
        return twist
