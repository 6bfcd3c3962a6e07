"""Pose and Jacobian of the tip of the tool that a robot holds."""

import math

import numpy as np

from app.fixture import JointLimits
from app.geometry import FloatArray, FrameError, InputError, Transform
from app.robot import Robot


class ToolKinematics:
    """The tip at ``link_from_tip`` of a link, moved by the joints on the way to that link.

    Raises `FrameError` for a transform of another link.
    """

    def __init__(self, robot: Robot, link_from_tip: Transform) -> None:
        self._robot, self._link_from_tip = robot, link_from_tip
        self._link = link_from_tip.target
        if self._link not in {link.name for link in robot.links}:
            raise FrameError(
                f"the tool is held by {self._link!r}; "
                f"expected one of {', '.join(link.name for link in robot.links)}"
            )
        self.joints = robot.actuated_joint_names

    @property
    def base(self) -> str:
        """The robot's base link."""
        return self._robot.root_link

    def evaluate(self, positions: FloatArray) -> tuple[Transform, FloatArray]:
        """``base_from_tip``, and the Jacobian (6, n) of the tip for all actuated joints.

        Rows are the tip's velocity (mm) and angular velocity (rad) in the base's axes, per rad or
        m. Raises `JointError` for positions that are not finite or at which a loop does not close.
        """
        named = dict(zip(self.joints, positions.tolist(), strict=True))
        base_from_link, jacobian = self._robot.jacobian(self._link, named)
        lever = base_from_link.rotate(self._link_from_tip.translation_mm)
        jacobian[:3] += np.cross(jacobian[3:].T, lever).T
        return base_from_link @ self._link_from_tip, jacobian

    def limits(self, max_speed: float | None = None) -> JointLimits:
        """Limits of the joints; ``max_speed`` for those that the robot's file gives none.

        Raises `InputError` where neither gives one.
        """
        found = {joint.name: joint for joint in self._robot.joints}
        speeds = []
        for name in self.joints:
            speed = found[name].dynamics.velocity or max_speed
            if speed is None or not (math.isfinite(speed) and speed > 0.0):
                raise InputError(
                    f"joint {name!r} has the speed limit {found[name].dynamics.velocity}; "
                    "expected one above 0 in the robot's file, or a largest joint speed"
                )
            speeds.append(speed)
        return JointLimits(
            np.array([found[name].lower for name in self.joints]),
            np.array([found[name].upper for name in self.joints]),
            np.array(speeds),
        )
