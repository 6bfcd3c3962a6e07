"""Robot-world calibration (AX = YB): a robot's base from poses of its tip and a sensor on it.

For every pose ``i``, ``reference_from_base @ base_from_tip[i] @ tip_from_sensor`` equals the
measured ``reference_from_sensor[i]``; the first and the last transform are unknown. Closed forms
propagate rotation errors into the translation and do not weight rad against mm. Therefore a closed
form is used only as the start of a maximum-likelihood estimate on SE(3).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import find_consensus
from app.registration.errors import DegenerateMotionError, UnequalCountsError
from app.registration.inputs import as_points
from app.registration.motion import origin_change
from app.registration.poses import PoseNoise, PoseStack
from app.registration.robot_base.robot_world_fit import (
    RobotWorld,
    closed_form,
    fit_with_noise_estimate,
    information_of,
    jacobian_of,
    maximum_likelihood,
    residuals_of,
)
from app.registration.uncertainty.acceptance import AcceptanceLimits, evaluate_acceptance
from app.registration.uncertainty.result import RegistrationResult, checked_covariance, read_only

MIN_POSES = 4
"""Three poses determine both transforms; more are needed for a check."""

MIN_TURN_RAD = math.radians(15.0)
"""Minimum of the largest rotation between two poses."""

MIN_SECOND_TURN_RAD = math.radians(4.0)
"""Minimum RMS rotation about a second axis: parallel axes leave the base free along them."""

NOMINAL_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""Noise of an EM sensor, the start of the noise estimate."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotWorldResult:
    """Result of a robot-world calibration.

    ``registration``
        Its transform is ``reference_from_base``, its residuals are those of the sensor's position.
    ``tip_from_sensor``
        Mount of the sensor on the robot's tip.
    ``covariance`` (12, 12)
        Of the small motions (rad, mm) of the base in the reference frame and of the mount in the
        tip's frame, each as defined in `app.registration.motion`.
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

    @property
    def reference_from_base(self) -> Transform:
        """Pose of the robot's base in the reference frame."""
        return self.registration.transform

    @property
    def accepted(self) -> bool:
        """True if the registration of the base may be used."""
        return self.registration.accepted

    @property
    def reason(self) -> str:
        """One line that explains `accepted`."""
        return self.registration.reason

    @property
    def outliers(self) -> tuple[int, ...]:
        """Indices of poses that were rejected."""
        return self.registration.outliers


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
    covariance = _about_origin(np.asarray(np.linalg.inv(information)), centre)
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
    rotations = poses.relative_rotations()
    largest = float(np.linalg.norm(rotations, axis=1).max())
    if largest < MIN_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of {what} rotate by at most {math.degrees(largest):.3g} degrees; "
            f"expected at least {math.degrees(MIN_TURN_RAD):g}"
        )
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


def _about_origin(about_centre: FloatArray, centre_mm: FloatArray) -> FloatArray:
    """Convert the base part of a covariance (12, 12) from ``centre_mm`` to the origin."""
    change = np.eye(12)
    change[:6, :6] = origin_change(-centre_mm)
    return np.asarray(change @ about_centre @ change.T)
