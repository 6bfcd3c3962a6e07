"""Joints that close a loop of links: the residual that is 0 where the loop closes."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.robot.errors import UrdfError
from app.robot.kinematics.joint import MM_PER_M

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
