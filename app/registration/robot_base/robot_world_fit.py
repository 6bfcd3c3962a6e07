"""Numerics of `robot_world`: closed form, maximum likelihood, noise estimate.

Solves ``Y A_i X = B_i``: A are the robot's poses, B the sensor's, Y is the base, X the mount.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s

from app.geometry import FloatArray, Transform
from app.registration.errors import ConvergenceError
from app.registration.least_squares import least_squares
from app.registration.motion import apply_motion, skew
from app.registration.poses import PoseNoise, PoseStack

MAX_NOISE_ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False)
class RobotWorld:
    """Estimate of both unknown transforms."""

    reference_from_base: Transform
    tip_from_sensor: Transform


def closed_form(robot: PoseStack, sensor: PoseStack) -> RobotWorld:
    """Compute rotations from the leading singular vectors of ``sum A_i (x) B_i``, then translations
    by linear least squares.

    Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", 2013.
    """
    product = np.einsum("nij,nkl->ikjl", robot.rotations, sensor.rotations).reshape(9, 9)
    left, _, right = np.linalg.svd(product)
    base = left[:, 0].reshape(3, 3).T
    mount_inverse = right[0].reshape(3, 3).T
    # The common sign of the singular vectors is free; a rotation has a positive determinant.
    sign = np.sign(np.linalg.det(base))
    base, mount = _nearest_rotation(sign * base), _nearest_rotation(sign * mount_inverse).T
    count = len(robot.rotations)
    columns = np.zeros((count, 3, 6))
    columns[:, :, :3], columns[:, :, 3:] = base @ robot.rotations, np.eye(3)
    right_side = sensor.translations_mm - robot.translations_mm @ base.T
    solution = np.asarray(
        np.linalg.lstsq(columns.reshape(-1, 6), right_side.ravel(), rcond=None)[0], dtype=np.float64
    )
    return RobotWorld(
        Transform(sensor.target, robot.target, base, solution[3:]),
        Transform(robot.source, sensor.source, mount, solution[:3]),
    )


def residuals_of(state: RobotWorld, robot: PoseStack, sensor: PoseStack) -> FloatArray:
    """Measured minus predicted sensor pose, (n, 6): rotation vector in rad, position in mm."""
    base, mount = state.reference_from_base, state.tip_from_sensor
    tips = robot.rotations @ mount.translation_mm + robot.translations_mm
    rotations = base.rotation @ robot.rotations @ mount.rotation
    turns = sensor.rotations @ np.swapaxes(rotations, 1, 2)
    vectors = scipy.spatial.transform.Rotation.from_matrix(turns).as_rotvec()
    return np.hstack([vectors, sensor.translations_mm - base.apply(tips)])


def jacobian_of(
    state: RobotWorld, robot: PoseStack, residuals: FloatArray, centre_mm: FloatArray
) -> FloatArray:
    """Negative Jacobian (n, 6, 12) of the residuals by motions of the base and the mount.

    Motions of the base are about ``centre_mm``, those of the mount about the tip's origin.
    """
    base, mount = state.reference_from_base, state.tip_from_sensor
    rotated = base.rotation @ robot.rotations
    positions = base.apply(robot.rotations @ mount.translation_mm + robot.translations_mm)
    # Inverse right Jacobian of SO(3) at the rotation residual, to second order.
    residual_skew = skew(residuals[:, :3])
    inverse_right = np.eye(3) + 0.5 * residual_skew + residual_skew @ residual_skew / 12.0
    jacobian = np.zeros((len(rotated), 6, 12))
    jacobian[:, :3, :3] = inverse_right
    jacobian[:, :3, 6:9] = inverse_right @ rotated
    jacobian[:, 3:, :3] = -skew(positions - centre_mm)
    jacobian[:, 3:, 3:6] = np.eye(3)
    jacobian[:, 3:, 6:9] = -rotated @ skew(mount.translation_mm)
    jacobian[:, 3:, 9:] = rotated
    return jacobian


def maximum_likelihood(
    robot: PoseStack, sensor: PoseStack, noise: PoseNoise, start: RobotWorld
) -> RobotWorld:
    """Minimise the squared rotation and translation residuals, each divided by its sigma."""
    centre = sensor.translations_mm.mean(axis=0)
    sigmas = noise.sigmas

    def linearise(state: RobotWorld) -> tuple[FloatArray, FloatArray]:
        residuals = residuals_of(state, robot, sensor)
        jacobian = jacobian_of(state, robot, residuals, centre)
        return (residuals / sigmas).ravel(), (jacobian / sigmas[:, None]).reshape(-1, 12)

    def retract(state: RobotWorld, step: FloatArray) -> RobotWorld:
        return RobotWorld(
            apply_motion(state.reference_from_base, step[:6], centre),
            apply_motion(state.tip_from_sensor, step[6:], np.zeros(3)),
        )

    return least_squares(start, linearise, retract, "robot-world calibration")


def fit_with_noise_estimate(
    robot: PoseStack, sensor: PoseStack, start: RobotWorld, noise: PoseNoise
) -> tuple[RobotWorld, PoseNoise]:
    """Return the estimate and the noise estimated from its residuals (variance components).

    The variance of each kind of residual is its sum of squares divided by its degrees of freedom:
    the number of its residuals minus the trace of its block of the hat matrix. Raises
    `ConvergenceError`.
    """
    state = start
    for _ in range(MAX_NOISE_ROUNDS):
        state = maximum_likelihood(robot, sensor, noise, state)
        residuals = residuals_of(state, robot, sensor)
        centre = sensor.translations_mm.mean(axis=0)
        jacobian = jacobian_of(state, robot, residuals, centre) / noise.sigmas[:, None]
        flat = jacobian.reshape(-1, 12)
        hat = np.einsum("nij,jk,nik->ni", jacobian, np.linalg.inv(flat.T @ flat), jacobian)
        freedom = (1.0 - hat).reshape(-1, 2, 3).sum(axis=(0, 2))
        variances = (residuals**2).reshape(-1, 2, 3).sum(axis=(0, 2)) / freedom
        # The floor, far below the noise of trackers, keeps noise-free data finite.
        sigmas = np.maximum(np.sqrt(variances), [1e-9, 1e-7])
        change = np.abs(np.log(sigmas / [noise.rotation_rad, noise.translation_mm])).max()
        noise = PoseNoise(float(sigmas[0]), float(sigmas[1]))
        if change < 1e-6 or np.any(sigmas <= [1e-9, 1e-7]):
            return state, noise
    raise ConvergenceError(f"noise of the poses did not converge in {MAX_NOISE_ROUNDS} rounds")


def information_of(
    state: RobotWorld, robot: PoseStack, sensor: PoseStack, noise: PoseNoise
) -> FloatArray:
    """Information matrix (12, 12) of the base, about the centre of the sensors, and the mount."""
    residuals = residuals_of(state, robot, sensor)
    centre = sensor.translations_mm.mean(axis=0)
    jacobian = jacobian_of(state, robot, residuals, centre) / noise.sigmas[:, None]
    flat = jacobian.reshape(-1, 12)
    return np.asarray(flat.T @ flat)


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    left, _, right = np.linalg.svd(matrix)
    handedness = np.sign(np.linalg.det(left) * np.linalg.det(right))
    return np.asarray(left @ np.diag([1.0, 1.0, handedness]) @ right)
