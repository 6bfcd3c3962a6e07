"""Links, joints and loop closures of a robot, as its file states them, and the errors of robots.

Masses and drives are for simulation. Kinematics do not need them: values that cannot be simulated,
such as a mass of 0, are kept as they are in the file; `app.simulation` refuses them.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError, MarginGuardError, SurfaceMesh, Transform


class RobotError(MarginGuardError):
    """Base class of the errors of this package."""


class UrdfError(RobotError, InputError):
    """A robot description is unsafe, malformed, or not one tree of links."""


class AdfError(RobotError, InputError):
    """An AMBF description file is malformed, or does not describe trees of bodies."""


class RobotMeshError(RobotError, InputError):
    """A mesh of a robot is missing, outside its package, of an unknown format, or malformed."""


class JointError(RobotError, InputError):
    """A joint or link is unknown, or a joint position is missing or not a finite number."""


class UnreachableError(RobotError):
    """Inverse kinematics found no joint positions within the limits for a pose."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkInertia:
    """Mass in kg and where it is.

    ``link_from_inertial`` (mm) is the frame of the centre of mass. ``tensor_kg_m2`` (3, 3) is about
    that centre, in the axes of that frame; None where the file gives a mass alone (AMBF).
    """

    mass_kg: float
    link_from_inertial: Transform
    tensor_kg_m2: FloatArray | None


@dataclass(frozen=True, slots=True)
class JointDynamics:
    """Limits of a joint's drive, and its losses, in N m and rad (N and m for sliding joints).

    ``effort`` and ``velocity`` are the largest of the drive, None where the file gives none.
    """

    effort: float | None = None
    velocity: float | None = None
    damping: float = 0.0
    friction: float = 0.0

    @property
    def is_finite(self) -> bool:
        """True if no value is infinite or NaN."""
        values = (self.effort, self.velocity, self.damping, self.friction)
        return all(value is None or math.isfinite(value) for value in values)


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


MM_PER_RAD = 100.0
"""Weight of angles against lengths in a residual: 1 rad counts as 100 mm."""


class ClosureType(StrEnum):
    """Relation that a closing joint maintains.

    ``ball``: a point. ``revolute``: a point and an axis. ``prismatic``: an axis and the rotation
    about it. ``fixed``: the whole pose.
    """

    BALL = "ball"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True, eq=False)
class LoopClosure:
    """Joint ``name``: its frame on ``parent`` meets its frame on ``child``.

    ``parent_from_joint`` and ``child_from_joint`` (4, 4) are rigid, in mm; z is the joint's axis.
    Raises `UrdfError` for numbers that are not finite.
    """

    name: str
    type: ClosureType
    parent: str
    child: str
    parent_from_joint: FloatArray
    child_from_joint: FloatArray

    def __post_init__(self) -> None:
        for matrix in (self.parent_from_joint, self.child_from_joint):
            if not np.isfinite(matrix).all():
                raise UrdfError(
                    f"joint {self.name!r} between {self.parent!r} and {self.child!r} has a frame "
                    "that is not finite; expected finite numbers"
                )

    def residual(self, root_from_parent: FloatArray, root_from_child: FloatArray) -> FloatArray:
        """Return the residual (k,) in mm, angles times `MM_PER_RAD`, for two poses (4, 4)."""
        error_mm, rotation = self._relative(root_from_parent, root_from_child)
        match self.type:
            case ClosureType.BALL:
                return error_mm
            case ClosureType.REVOLUTE:
                return np.concatenate([error_mm, MM_PER_RAD * rotation[:2, 2]])
        turn = MM_PER_RAD * scipy.spatial.transform.Rotation.from_matrix(rotation).as_rotvec()
        kept = error_mm[:2] if self.type is ClosureType.PRISMATIC else error_mm
        return np.concatenate([kept, turn])

    def columns(
        self,
        root_from_parent: FloatArray,
        root_from_child: FloatArray,
        axes: FloatArray,
        pivots_mm: FloatArray,
        slides: NDArray[np.bool_],
    ) -> FloatArray:
        """Return the derivative (k, n) of the residual by joints that each move ``child`` alone.

        ``axes`` and ``pivots_mm`` (n, 3) are those of the moving joints in the root frame; per rad,
        or per m where a joint ``slides`` (n,). For a joint that moves ``parent`` alone it is the
        negative. Exact where the residual is 0.
        """
        frame = (root_from_parent @ self.parent_from_joint)[:3, :3]
        child = root_from_child @ self.child_from_joint
        of_sliding = slides[:, None]
        speed = np.where(of_sliding, MM_PER_M * axes, np.cross(axes, child[:3, 3] - pivots_mm))
        speed, turn = speed @ frame, np.where(of_sliding, 0.0, axes) @ frame
        match self.type:
            case ClosureType.BALL:
                return speed.T
            case ClosureType.REVOLUTE:
                swing = np.cross(turn, frame.T @ child[:3, 2])
                return np.concatenate([speed.T, MM_PER_RAD * swing[:, :2].T])
        kept = speed[:, :2] if self.type is ClosureType.PRISMATIC else speed
        return np.concatenate([kept.T, MM_PER_RAD * turn.T])

    def gap(self, root_from_parent: FloatArray, root_from_child: FloatArray) -> tuple[float, float]:
        """Return how far the two frames are apart: mm, and rad (0 to pi)."""
        residual = self.residual(root_from_parent, root_from_child)
        points = 2 if self.type is ClosureType.PRISMATIC else 3
        angle = float(np.linalg.norm(residual[points:])) / MM_PER_RAD
        if self.type is ClosureType.REVOLUTE:
            _, rotation = self._relative(root_from_parent, root_from_child)
            angle = math.atan2(angle, float(rotation[2, 2]))
        return float(np.linalg.norm(residual[:points])), angle

    def _relative(
        self, root_from_parent: FloatArray, root_from_child: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and rotation (3, 3) of the child's joint frame in the parent's."""
        parent = root_from_parent @ self.parent_from_joint
        child = root_from_child @ self.child_from_joint
        rotation = parent[:3, :3].T
        return rotation @ (child[:3, 3] - parent[:3, 3]), rotation @ child[:3, :3]


Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One ``<visual>`` or ``<collision>``: a surface in its link's frame, in mm, origin applied.

    ``color`` (0 to 1) is that of the URDF's material, else that of the mesh file. A file of several
    colours gives ``face_colors`` (m, 4), one for each face of ``mesh``, and its most common one as
    ``color``. ``source`` is the file name in the URDF, or the kind of primitive (``box``).
    """

    mesh: SurfaceMesh
    color: Rgba | None
    source: str
    face_colors: FloatArray | None = None

    @classmethod
    def with_face_colors(
        cls, mesh: SurfaceMesh, face_colors: FloatArray | None, source: str
    ) -> Self:
        """Make a shape from ``mesh`` and the colours (m, 4) of its file, None where it has none."""
        if face_colors is None:
            return cls(mesh, None, source)
        distinct, counts = np.unique(face_colors, axis=0, return_counts=True)
        red, green, blue, alpha = distinct[np.argmax(counts)].tolist()
        several = face_colors if len(distinct) > 1 else None
        return cls(mesh, (red, green, blue, alpha), source, several)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body of the robot, with the shapes for display and those for collision.

    ``inertia`` is None where the file gives no mass.
    """

    name: str
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    inertia: LinkInertia | None = None
