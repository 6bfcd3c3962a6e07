"""Joints with the semantics of URDF: how a child link moves relative to its parent."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from app.geometry import FloatArray, Transform
from app.robot.dynamics import JointDynamics
from app.robot.errors import UrdfError

MM_PER_M = 1000.0


class JointType(StrEnum):
    """Supported joint types, with at most one degree of freedom.

    ``floating`` and ``planar`` joints are refused, because one position cannot place them.
    """

    FIXED = "fixed"
    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class Mimic:
    """``position = multiplier * position of leader + offset``, in rad, in m for sliding joints."""

    leader: str
    multiplier: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("multiplier", "offset"):
            if not math.isfinite(getattr(self, name)):
                raise UrdfError(
                    f"{name} of the mimic of {self.leader!r} is {getattr(self, name)}; "
                    "expected a finite number"
                )


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Connects ``child`` to ``parent``: the origin, then the motion about or along ``axis``.

    ``origin`` is ``parent_from_child`` at position 0. ``axis`` (3,) is a unit vector and
    ``pivot_mm`` (3,) a point of the axis, both in the child's frame. In URDF the pivot is the
    origin, in AMBF any point. ``lower`` and ``upper`` are in rad, in m for sliding joints, and
    infinite for continuous ones. Inverse kinematics stays within them, forward kinematics does not
    clip to them. Raises `UrdfError` for values that are not finite and for an axis of length 0.
    """

    name: str
    type: JointType
    origin: Transform
    axis: FloatArray
    lower: float = -math.inf
    upper: float = math.inf
    mimic: Mimic | None = None
    pivot_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    dynamics: JointDynamics = field(default_factory=JointDynamics)

    def __post_init__(self) -> None:
        axis = np.array(self.axis, dtype=np.float64)
        if axis.shape != (3,) or not np.isfinite(axis).all():
            raise UrdfError(f"axis of joint {self.name!r} is {axis.tolist()}; expected 3 numbers")
        length = float(np.linalg.norm(axis))
        if self.type is not JointType.FIXED:
            if length < 1e-9:
                raise UrdfError(
                    f"axis of joint {self.name!r} is {axis.tolist()}; expected a direction"
                )
            axis /= length
        # Also true for NaN limits.
        if not self.lower <= self.upper:
            raise UrdfError(
                f"limits of joint {self.name!r} are {self.lower} to {self.upper}; "
                "expected lower <= upper"
            )
        pivot_mm = np.array(self.pivot_mm, dtype=np.float64)
        if pivot_mm.shape != (3,) or not np.isfinite(pivot_mm).all():
            raise UrdfError(
                f"pivot of joint {self.name!r} is {pivot_mm.tolist()} mm; expected 3 numbers"
            )
        axis.flags.writeable = pivot_mm.flags.writeable = False
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "pivot_mm", pivot_mm)

    @property
    def parent(self) -> str:
        """The parent link."""
        return self.origin.target

    @property
    def child(self) -> str:
        """The child link."""
        return self.origin.source

    @property
    def moves(self) -> bool:
        """True unless the joint is fixed."""
        return self.type is not JointType.FIXED

    @property
    def slides(self) -> bool:
        """True if the position is a length (m), false if it is an angle (rad)."""
        return self.type is JointType.PRISMATIC

    @property
    def twist(self) -> FloatArray:
        """T (4, 4) of the motion ``I + a T + b T^2`` of the child from its pose at 0, in mm.

        A rotation by q has a = sin q, b = 1 - cos q (Rodrigues; Murray, Li and Sastry, A
        Mathematical Introduction to Robotic Manipulation, 1994, equation 2.36). A translation by
        q metres has a = q, and T^2 is 0. The T of a fixed joint is 0.
        """
        twist = np.zeros((4, 4))
        if self.slides:
            twist[:3, 3] = MM_PER_M * self.axis
        elif self.moves:
            x, y, z = self.axis.tolist()
            twist[:3, :3] = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
            twist[:3, 3] = -twist[:3, :3] @ self.pivot_mm
        return twist
