"""The numbers behind `robot_world`: closed form, maximum likelihood, noise.

All in arrays of ``Y A_i X = B_i``: A the robot's poses, B the sensor's, Y the base, X the mount.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.registration.errors import ConvergenceError
from app.registration.least_squares import least_squares
from app.registration.motion import moved, skew
from app.registration.poses import PoseNoise, PoseStack

MAX_NOISE_ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False)
class RobotWorld:
    """A candidate for both unknown transforms."""

    reference_from_base: Transform
    tip_from_sensor: Transform


def closed_form(robot: PoseStack, sensor: PoseStack) -> RobotWorld:
    """Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product",
    2013: rotations from the leading singular vectors of ``sum A_i (x) B_i``, then translations
    by linear least squares.
    """
    product = np.einsum("nij,nkl->ikjl", robot.rotations, sensor.rotations).reshape(9, 9)
    left, _, right = np.linalg.svd(product)
    base = left[:, 0].reshape(3, 3).T
    mount_inverse = right[0].reshape(3, 3).T
    # The pair of vectors is known up to a common sign: rotations have a positive determinant.
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
    """Measured against predicted sensor pose, (n, 6): rotation vector in rad, position in mm."""
    base, mount = state.reference_from_base, state.tip_from_sensor
    tips = robot.rotations @ mount.translation_mm + robot.translations_mm
    rotations = base.rotation @ robot.rotations @ mount.rotation
    turns = Rotation.from_matrix(sensor.rotations @ np.swapaxes(rotations, 1, 2)).as_rotvec()
    return np.hstack([turns, sensor.translations_mm - base.apply(tips)])


def jacobian_of(
    state: RobotWorld, robot: PoseStack, residuals: FloatArray, centre_mm: FloatArray
) -> FloatArray:
    """How the residuals fall, (n, 6, 12), with motions of the base about ``centre_mm`` and of the
    mount about the tip's origin.
    """
    base, mount = state.reference_from_base, state.tip_from_sensor
    turned = base.rotation @ robot.rotations
    positions = base.apply(robot.rotations @ mount.translation_mm + robot.translations_mm)
    # The rotation residual answers to a turn by the inverse right Jacobian of SO(3), to 2nd order.
    bent = skew(residuals[:, :3])
    answer = np.eye(3) + 0.5 * bent + bent @ bent / 12.0
    jacobian = np.zeros((len(turned), 6, 12))
    jacobian[:, :3, :3] = answer
    jacobian[:, :3, 6:9] = answer @ turned
    jacobian[:, 3:, :3] = -skew(positions - centre_mm)
    jacobian[:, 3:, 3:6] = np.eye(3)
    jacobian[:, 3:, 6:9] = -turned @ skew(mount.translation_mm)
    jacobian[:, 3:, 9:] = turned
    return jacobian


def maximum_likelihood(
    robot: PoseStack, sensor: PoseStack, noise: PoseNoise, start: RobotWorld
) -> RobotWorld:
    """The least squares of rotation and translation residuals, each over its own sigma."""
    centre = sensor.translations_mm.mean(axis=0)
    sigmas = noise.sigmas

    def linearise(state: RobotWorld) -> tuple[FloatArray, FloatArray]:
        residuals = residuals_of(state, robot, sensor)
        jacobian = jacobian_of(state, robot, residuals, centre)
        return (residuals / sigmas).ravel(), (jacobian / sigmas[:, None]).reshape(-1, 12)

    def retract(state: RobotWorld, step: FloatArray) -> RobotWorld:
        return RobotWorld(
            moved(state.reference_from_base, step[:6], centre),
            moved(state.tip_from_sensor, step[6:], np.zeros(3)),
        )

    return least_squares(start, linearise, retract, "robot-world calibration")


def with_estimated_noise(
    robot: PoseStack, sensor: PoseStack, start: RobotWorld, noise: PoseNoise
) -> tuple[RobotWorld, PoseNoise]:
    """The estimate and the noise that explains its own residuals (variance components).

    Each kind of residual gives its variance over its own share of the degrees of freedom, which
    is the number of its residuals less the trace of its block of the hat matrix.
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
        # Noise-free data have no noise to find: a floor far below any tracker's keeps it finite.
        found = np.maximum(np.sqrt(variances), [1e-9, 1e-7])
        change = np.abs(np.log(found / [noise.rotation_rad, noise.translation_mm])).max()
        noise = PoseNoise(float(found[0]), float(found[1]))
        if change < 1e-6 or np.any(found <= [1e-9, 1e-7]):
            return state, noise
    raise ConvergenceError(f"the noise of the poses did not settle in {MAX_NOISE_ROUNDS} rounds")


def information_of(
    state: RobotWorld, robot: PoseStack, sensor: PoseStack, noise: PoseNoise
) -> FloatArray:
    """Information matrix (12, 12) of the base about the sensors' centre, and of the mount."""
    residuals = residuals_of(state, robot, sensor)
    centre = sensor.translations_mm.mean(axis=0)
    jacobian = jacobian_of(state, robot, residuals, centre) / noise.sigmas[:, None]
    flat = jacobian.reshape(-1, 12)
    return np.asarray(flat.T @ flat)


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    left, _, right = np.linalg.svd(matrix)
    hand = np.sign(np.linalg.det(left) * np.linalg.det(right))
    return np.asarray(left @ np.diag([1.0, 1.0, hand]) @ right)
