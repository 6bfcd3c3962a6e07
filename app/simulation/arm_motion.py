"""Motion of an arm's drives for a command: joint velocities, or efforts for a wrench.

Poses and twists of the tool become joint velocities by damped least squares (Nakamura and Hanafusa,
Inverse Kinematic Solutions with Singularity Robustness, 1986). A position or pose is approached
with a time constant; the servo limits speeds and ends of travel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray
from app.simulation.command_gate import (
    ArmCommand,
    JointPositionCommand,
    JointVelocityCommand,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
)
from app.simulation.rigid_body import M_PER_MM
from app.simulation.world_model import RobotModel

BANDWIDTH_HZ = 300.0
"""Rate in 1/s at which an error of the velocity decays."""

LIMIT_S = 0.02
"""Time constant with which the velocity falls to 0 towards a joint limit."""

FADE = 10.0
"""1 over the share of the speed limit below it in which the efforts of a wrench fade out."""
APPROACH_S = 0.02
"""Time constant with which a position or a pose is approached."""
DAMPING = 0.01
"""Damping of the least squares: m or rad of the tool per rad of a joint where a direction fades."""


class VelocityServo:
    """The drives of one robot. Evaluate between `mujoco.mj_step1` and `mujoco.mj_step2`.

    Computed torque: weight, Coriolis forces and inertia come from the model, everything else, such
    as a hand or a contact, from a disturbance observer of one step (Ohnishi, Shibata and Murakami,
    Motion Control for Advanced Mechatronics, 1996). A blocked arm so presses with up to its effort
    limits.
    """

    def __init__(self, model: Any, robot: RobotModel) -> None:
        def numbers(kind: Any, names: Sequence[str]) -> NDArray[np.int64]:
            """Numbers (n,) of joints or actuators in the model."""
            found = [mujoco.mj_name2id(model, kind, f"{robot.entry.name}/{each}") for each in names]
            return np.array(found, np.int64)

        drives = robot.drives
        self.joints = tuple(drive.name for drive in drives)
        driven = numbers(mujoco.mjtObj.mjOBJ_JOINT, self.joints)
        self.dofs = np.array(model.jnt_dofadr[driven], np.int64)
        self.positions = np.array(model.jnt_qposadr[driven], np.int64)
        # The driven joints first: without others, blocks of the model's matrices are theirs.
        every = model.jnt_dofadr[numbers(mujoco.mjtObj.mjOBJ_JOINT, robot.joints)].tolist()
        others = [dof for dof in every if dof not in set(self.dofs.tolist())]
        self._all = np.array([*self.dofs.tolist(), *others], np.int64)
        self._order = np.arange(len(self.joints))
        self._following = np.arange(len(self.joints), len(self._all))
        self._block = np.ix_(self._all, self._all)
        self.actuators = numbers(mujoco.mjtObj.mjOBJ_ACTUATOR, self.joints)
        self._effort = np.array([drive.effort for drive in drives])
        self._inverse_velocity = 1.0 / np.array([drive.velocity for drive in drives])
        self._lower = np.array([drive.lower for drive in drives])
        self._upper = np.array([drive.upper for drive in drives])
        self._timestep = float(model.opt.timestep)
        self.reset()

    def reset(self) -> None:
        """Forget the disturbance."""
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self.torques: FloatArray = np.zeros(len(self.joints))

    def limited(self, velocities: FloatArray, positions: FloatArray) -> FloatArray:
        """``velocities`` (n,) scaled to the speed limits and slowed towards the joint limits."""
        ratio = float((np.abs(velocities) * self._inverse_velocity).max(initial=0.0))
        scaled = velocities / max(1.0, ratio)
        upper = np.maximum((self._upper - positions) / LIMIT_S, 0.0)
        lower = np.minimum((self._lower - positions) / LIMIT_S, 0.0)
        return np.asarray(np.minimum(np.maximum(scaled, lower), upper))

    def of_driven(self, jacobian: FloatArray, data: Any) -> FloatArray:
        """The part (m, n) of a Jacobian (m, nv) for the driven joints; the others follow them."""
        share = self._share(data)
        return np.asarray(
            jacobian[:, self.dofs] if share is None else jacobian[:, self._all] @ share
        )

    def apply(
        self,
        data: Any,
        inertia: FloatArray,
        commanded: FloatArray,
        efforts: FloatArray | None = None,
    ) -> None:
        """Set the efforts for joint velocities ``commanded`` (n,); ``inertia`` is (nv, nv).

        With ``efforts`` (n,) the drives give those and balance the weight instead; they resist
        only beyond the speed limits and at the ends of travel.
        """
        share = self._share(data)
        mass = inertia[self._block]
        bias = (data.qfrc_bias - data.qfrc_passive)[self._all]
        if share is not None:
            mass, bias = share.T @ mass @ share, share.T @ bias
        velocity = data.qvel[self.dofs]
        disturbance: FloatArray = np.zeros(len(self.joints))
        if self._last is not None:
            last_mass, last_bias, last_velocity = self._last
            acceleration = (velocity - last_velocity) / self._timestep
            disturbance = last_mass @ acceleration + last_bias - self.torques
        if efforts is None:
            target = self.limited(commanded, data.qpos[self.positions])
            torques = mass @ (BANDWIDTH_HZ * (target - velocity)) + bias - disturbance
        else:
            target = self.limited(velocity, data.qpos[self.positions])
            weight = data.qfrc_bias[self._all]
            weight = weight if share is None else share.T @ weight
            torques = mass @ (BANDWIDTH_HZ * (target - velocity)) + weight
            torques = torques + self._within_speed(efforts, velocity)
        self.torques = np.minimum(np.maximum(torques, -self._effort), self._effort)
        self._last = mass, bias, velocity.copy()
        data.ctrl[self.actuators] = self.torques

    def _within_speed(self, efforts: FloatArray, velocity: FloatArray) -> FloatArray:
        """``efforts`` (n,), which fade out in the last tenth below the speed limit of a joint."""
        left = FADE * (1.0 - np.abs(velocity) * self._inverse_velocity)
        is_along = efforts * velocity > 0.0
        limited = np.clip(efforts, -self._effort, self._effort)
        return np.asarray(limited * np.where(is_along, np.clip(left, 0.0, 1.0), 1.0))

    def _share(self, data: Any) -> FloatArray | None:
        """Velocities of the robot's joints (m, n) per velocity of each driven one.

        None if all joints are driven.
        """
        if not len(self._following):
            return None
        share = np.zeros((len(self._all), len(self.joints)))
        share[self._order, np.arange(len(self.joints))] = 1.0
        jacobian = data.efc_J.reshape(-1, len(data.qvel))[: data.ne, self._all]
        following, *_ = np.linalg.lstsq(
            jacobian[:, self._following], -jacobian[:, self._order], rcond=None
        )
        share[self._following] = following
        return share


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
