"""Robot-world calibration (AX = YB): a robot's base from poses of its tip and a sensor on it.

For every pose ``i``, ``reference_from_base @ base_from_tip[i] @ tip_from_sensor`` equals the
measured ``reference_from_sensor[i]``; the first and the last transform are unknown. Closed forms
propagate rotation errors into the translation and do not weight rad against mm. Therefore a closed
form is used only as the start of a maximum-likelihood estimate on SE(3). The numerics solve
``Y A_i X = B_i``: A are the robot's poses, B the sensor's, Y is the base, X the mount.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.spatial` lazily, which takes 0.2 s
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import find_consensus
from app.registration.input_checks import (
    ConvergenceError,
    DegenerateMotionError,
    UnequalCountsError,
    as_points,
)
from app.registration.pose_stack import PoseNoise, PoseStack
from app.registration.registration_checks import AcceptanceLimits, evaluate_acceptance
from app.registration.registration_result import RegistrationResult, checked_covariance, read_only
from app.registration.small_motion import apply_motion, least_squares, origin_change, skew

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


MIN_POSES = 4
"""Three poses determine both transforms; more are needed for a check."""

MIN_SECOND_TURN_RAD = math.radians(4.0)
"""Minimum RMS rotation about a second axis: parallel axes leave the base free along them."""

NOMINAL_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""Noise of an EM sensor, the start of the noise estimate."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotWorldResult:
    """Result of a robot-world calibration.

    ``registration``
        Its transform is the base's pose in the reference frame, its residuals are those of the
        sensor's position.
    ``tip_from_sensor``
        Mount of the sensor on the robot's tip.
    ``covariance`` (12, 12)
        Of the small motions (rad, mm) of the base in the reference frame and of the mount in the
        tip's frame, each as defined in `app.registration.small_motion`.
    ``residuals_rad`` (n,)
        Angle between measured and predicted sensor, outliers included.
    ``noise``
        Noise of one sensor pose, given or estimated from the residuals.
    """

    registration: RegistrationResult
    tip_from_sensor: Transform
    covariance: FloatArray
    residuals_rad: FloatArray
    noise: PoseNoise

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", checked_covariance(self.covariance, 12))
        object.__setattr__(self, "residuals_rad", read_only(self.residuals_rad))


def solve_robot_world(
    base_from_tip: Sequence[Transform],
    reference_from_sensor: Sequence[Transform],
    *,
    noise: PoseNoise | None = None,
    targets_mm: ArrayLike | None = None,
    limits: AcceptanceLimits | None = None,
) -> RobotWorldResult:
    """Compute the robot's base and the sensor's mount from n >= 4 simultaneous pose pairs.

    ``noise`` is that of a sensor pose; by default both its parts are estimated from the residuals.
    The noise of the robot is neglected: it is far below that of an EM tracker. ``targets_mm``
    (m, 3) in the reference frame are the points where the predicted error decides ``accepted``; the
    default is the centre of the sensor's positions.

    Raises `TooFewError`, `UnequalCountsError`, `FrameError`, `DegenerateMotionError` (one pose
    repeated, too little rotation, parallel axes) or `NoConsensusError` (no majority agrees).
    """
    if len(base_from_tip) != len(reference_from_sensor):
        raise UnequalCountsError(
            f"{len(base_from_tip)} robot poses and {len(reference_from_sensor)} sensor poses; "
            "expected one sensor pose per robot pose"
        )
    robot = PoseStack.from_poses(base_from_tip, "the robot's tip", min_count=MIN_POSES)
    sensor = PoseStack.from_poses(reference_from_sensor, "the sensor", min_count=MIN_POSES)
    _check_rotations(robot, "the robot's tip")
    _check_rotations(sensor, "the sensor")
    inliers, (state, used_noise) = _fit_inliers(robot, sensor, noise)
    used_robot, used_sensor = robot.select(inliers), sensor.select(inliers)
    _check_rotations(used_robot, "the robot's tip without outliers")

    information = information_of(state, used_robot, used_sensor, used_noise)
    centre = used_sensor.translations_mm.mean(axis=0)
    about_origin = np.eye(12)
    about_origin[:6, :6] = origin_change(-centre)
    covariance = about_origin @ np.linalg.inv(information) @ about_origin.T
    residuals = residuals_of(state, robot, sensor)
    distances = np.linalg.norm(residuals[:, 3:], axis=1)
    arm = math.sqrt(
        2.0 / 3.0 * float(np.mean(np.sum((used_sensor.translations_mm - centre) ** 2, axis=1)))
    )
    scale = np.tile(np.repeat([1.0 / max(arm, 1.0), 1.0], 3), 2)
    registration = RegistrationResult(
        transform=state.reference_from_base,
        residuals_mm=distances,
        fre_mm=math.sqrt(float(np.mean(distances[inliers] ** 2))),
        fle_mm=math.sqrt(3.0) * used_noise.translation_mm,
        leave_one_out_mm=_leave_one_out(robot, sensor, inliers, state, used_noise),
        covariance=covariance[:6, :6],
        condition=math.sqrt(float(np.linalg.cond(information * np.outer(scale, scale)))),
        accepted=False,
        reason="acceptance is not evaluated",
        method="robot_world",
        degrees_of_freedom=6 * int(inliers.sum()) - 12 if noise is None else None,
        outliers=tuple(np.flatnonzero(~inliers).tolist()),
    )
    targets = centre[None] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return RobotWorldResult(
        registration=evaluate_acceptance(registration, targets, limits or AcceptanceLimits()),
        tip_from_sensor=state.tip_from_sensor,
        covariance=covariance,
        residuals_rad=np.linalg.norm(residuals[:, :3], axis=1),
        noise=used_noise,
    )


def _check_rotations(poses: PoseStack, what: str) -> None:
    rotations = poses.relative_rotations(what)
    second = float(np.linalg.svd(rotations, compute_uv=False)[1]) / math.sqrt(len(rotations))
    if second < MIN_SECOND_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of {what} rotate about parallel axes: {math.degrees(second):.3g} degrees "
            f"RMS about a second axis; expected at least {math.degrees(MIN_SECOND_TURN_RAD):g}"
        )


def _fit_inliers(
    robot: PoseStack, sensor: PoseStack, noise: PoseNoise | None
) -> tuple[NDArray[np.bool_], tuple[RobotWorld, PoseNoise]]:
    """Return the mask of inliers (n,), the estimate from them and its noise."""

    def initialise(mask: NDArray[np.bool_]) -> tuple[RobotWorld, PoseNoise]:
        state = closed_form(robot.select(mask), sensor.select(mask))
        return state, noise or NOMINAL_NOISE

    def refine(
        mask: NDArray[np.bool_], fit: tuple[RobotWorld, PoseNoise]
    ) -> tuple[RobotWorld, PoseNoise]:
        used = robot.select(mask), sensor.select(mask)
        if noise is None:
            return fit_with_noise_estimate(*used, *fit)
        return maximum_likelihood(*used, noise, fit[0]), noise

    def linearise(fit: tuple[RobotWorld, PoseNoise]) -> tuple[FloatArray, FloatArray]:
        state, sigmas = fit[0], fit[1].sigmas
        residuals = residuals_of(state, robot, sensor)
        jacobian = jacobian_of(state, robot, residuals, sensor.translations_mm.mean(axis=0))
        return residuals / sigmas, jacobian / sigmas[:, None]

    return find_consensus(
        len(robot.rotations),
        "pose pairs",
        sample_size=MIN_POSES,
        noise_known=noise is not None,
        initialise=initialise,
        refine=refine,
        linearise=linearise,
    )


def _leave_one_out(
    robot: PoseStack,
    sensor: PoseStack,
    inliers: NDArray[np.bool_],
    state: RobotWorld,
    noise: PoseNoise,
) -> FloatArray:
    """Error (n,) in mm of each sensor position predicted from the other poses; NaN for outliers."""
    errors = np.full(len(inliers), np.nan)
    if inliers.sum() <= MIN_POSES:
        return errors
    for pose in np.flatnonzero(inliers):
        others = inliers.copy()
        others[pose] = False
        partial = maximum_likelihood(robot.select(others), sensor.select(others), noise, state)
        errors[pose] = np.linalg.norm(residuals_of(partial, robot, sensor)[pose, 3:])
    return errors
