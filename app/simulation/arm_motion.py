"""Motion of an arm's drives for a command: joint velocities, or efforts for a wrench.

Poses and twists of the tool become joint velocities by damped least squares (Nakamura and Hanafusa,
Inverse Kinematic Solutions with Singularity Robustness, 1986). A position or pose is approached
with a time constant; the servo limits speeds and ends of travel.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray
from app.simulation.commands import (
    ArmCommand,
    JointPositionCommand,
    JointVelocityCommand,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
)
from app.simulation.inertia import M_PER_MM
from app.simulation.servo import VelocityServo

APPROACH_S = 0.02
"""Time constant with which a position or a pose is approached."""

DAMPING = 0.01
"""Damping of the least squares: m or rad of the tool per rad of a joint where a direction fades."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveTarget:
    """Joint velocities (n,), or with ``efforts`` (n,) those above the balance of the weight."""

    velocities: FloatArray
    efforts: FloatArray | None = None


class ArmMotion:
    """Targets of the drives of ``servo``; ``tool`` is the tool's body, None without one.

    ``world_from_base`` (3, 3) and ``base_mm`` (3,) are the pose of the arm's root link.
    """

    def __init__(
        self,
        servo: VelocityServo,
        tool: int | None,
        world_from_base: FloatArray,
        base_mm: FloatArray,
    ) -> None:
        self._servo, self._tool = servo, tool
        self._world_from_base, self._base_mm = world_from_base, base_mm

    def target(self, command: ArmCommand | None, model: Any, data: Any) -> DriveTarget:
        """The target for ``command``, which a gate has accepted; None stands still."""
        servo = self._servo
        match command:
            case JointVelocityCommand():
                return DriveTarget(np.array(command.velocities))
            case JointPositionCommand():
                ahead = np.array(command.positions) - data.qpos[servo.positions]
                return DriveTarget(ahead / APPROACH_S)
            case ToolTwistCommand():
                twist = np.concatenate(
                    [M_PER_MM * np.array(command.linear_mm_s), command.angular_rad_s]
                )
                return self._following(self._in_world(twist, self._world_from_base), model, data)
            case ToolPoseCommand():
                return self._following(self._error(command, data) / APPROACH_S, model, data)
            case ToolWrenchCommand():
                axes = self._world_from_base
                if command.in_tool:
                    axes = data.xmat[self._tool].reshape(3, 3)
                wrench = self._in_world(np.array([*command.force_n, *command.torque_n_m]), axes)
                still = np.zeros(len(servo.joints))
                return DriveTarget(still, self._jacobian(model, data).T @ wrench)
        return DriveTarget(np.zeros(len(servo.joints)))

    def _following(self, twist: FloatArray, model: Any, data: Any) -> DriveTarget:
        jacobian = self._jacobian(model, data)
        square = jacobian @ jacobian.T + DAMPING**2 * np.eye(6)
        return DriveTarget(jacobian.T @ np.linalg.solve(square, twist))

    def _error(self, command: ToolPoseCommand, data: Any) -> FloatArray:
        """From the tool's pose to the commanded one: m, and a rotation vector, in the world."""
        turn = self._world_from_base
        position_mm = turn @ np.array(command.position_mm) + self._base_mm
        rotation = turn @ Rotation.from_quat(command.quaternion).as_matrix()
        ahead = M_PER_MM * position_mm - data.xpos[self._tool]
        away = Rotation.from_matrix(rotation @ data.xmat[self._tool].reshape(3, 3).T).as_rotvec()
        return np.concatenate([ahead, away])

    def _jacobian(self, model: Any, data: Any) -> FloatArray:
        """Jacobian (6, n) of the tool's origin for the driven joints, m and rad, in the world."""
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacBody(model, data, linear, angular, self._tool)
        return self._servo.of_driven(np.concatenate([linear, angular]), data)

    @staticmethod
    def _in_world(rows: FloatArray, axes: FloatArray) -> FloatArray:
        return np.concatenate([axes @ rows[:3], axes @ rows[3:]])
