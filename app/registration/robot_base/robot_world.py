"""Where the base of a robot stands, from poses of its tip and of a tracked sensor on it: AX = YB.

For every pose ``i``, ``reference_from_base @ base_from_tip[i] @ tip_from_sensor`` is what the
tracker measures as ``reference_from_sensor[i]``; the first and the last transform are unknown. The
closed forms let rotation errors run into the translation and weigh radians against nothing: here
one of them is only where the maximum-likelihood estimate on SE(3) starts.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import agreeing
from app.registration.errors import DegenerateMotionError, UnequalCountsError
from app.registration.inputs import as_points
from app.registration.motion import origin_change
from app.registration.poses import PoseNoise, PoseStack
from app.registration.robot_base.robot_world_fit import (
    RobotWorld,
    closed_form,
    information_of,
    jacobian_of,
    maximum_likelihood,
    residuals_of,
    with_estimated_noise,
)
from app.registration.uncertainty.acceptance import AcceptanceLimits, judge
from app.registration.uncertainty.result import RegistrationResult, checked_covariance, read_only

MIN_POSES = 4
"""Three poses determine both transforms and leave nothing to check them by."""

MIN_TURN_RAD = math.radians(15.0)
"""Least turn between the two poses that differ most."""

MIN_SECOND_TURN_RAD = math.radians(4.0)
"""Least RMS turn about a second axis: with parallel axes the base may slide along them."""

NOMINAL_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""An EM sensor's: where the search for the noise starts when the caller does not know it."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotWorldResult:
    """``registration.transform`` is ``reference_from_base``; its residuals are in position.

    ``tip_from_sensor``
        How the sensor is mounted on the robot's tip.
    ``covariance`` (12, 12)
        Of the small motions (rad, mm) of the base in the reference frame and of the mount in the
        tip's frame, each as `app.registration.motion` defines it.
    ``residuals_rad`` (n,)
        Angle between measured and predicted sensor, dropped poses included.
    ``noise``
        Of one sensor pose: handed in, or estimated from the residuals.
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
        """The robot's base in the reference frame."""
        return self.registration.transform

    @property
    def accepted(self) -> bool:
        """Whether the base may be used."""
        return self.registration.accepted

    @property
    def reason(self) -> str:
        """Why, or why not."""
        return self.registration.reason

    @property
    def outliers(self) -> tuple[int, ...]:
        """Indices of poses that were named wrong and dropped."""
        return self.registration.outliers


def solve_robot_world(
    base_from_tip: Sequence[Transform],
    reference_from_sensor: Sequence[Transform],
    *,
    noise: PoseNoise | None = None,
    targets_mm: ArrayLike | None = None,
    limits: AcceptanceLimits | None = None,
) -> RobotWorldResult:
    """The robot's base and the sensor's mount from n >= 4 pose pairs taken at the same moments.

    ``noise`` is that of a sensor pose (the robot's own is far below an EM tracker's); without it
    both its parts are estimated from the residuals. ``targets_mm`` (m, 3) in the reference frame
    are the places where ``accepted`` is decided; without them, at the centre of the sensor's
    positions.

    Raises `TooFewError`, `UnequalCountsError`, `FrameError`, `DegenerateMotionError` (one pose
    repeated, too little rotation, parallel axes) or `NoConsensusError` (no majority agrees).
    """
    if len(base_from_tip) != len(reference_from_sensor):
        raise UnequalCountsError(
            f"{len(base_from_tip)} robot poses and {len(reference_from_sensor)} sensor poses: "
            "one sensor pose for each robot pose wanted"
        )
    robot = PoseStack.of(base_from_tip, "the robot's tip", least=MIN_POSES)
    sensor = PoseStack.of(reference_from_sensor, "the sensor", least=MIN_POSES)
    _check_turns(robot, "the robot's tip")
    _check_turns(sensor, "the sensor")
    good, (state, found) = _agreeing(robot, sensor, noise)
    used_robot, used_sensor = robot.of_poses(good), sensor.of_poses(good)
    _check_turns(used_robot, "the robot's tip, wrong ones dropped,")

    information = information_of(state, used_robot, used_sensor, found)
    centre = used_sensor.translations_mm.mean(axis=0)
    covariance = _about_origin(np.asarray(np.linalg.inv(information)), centre)
    residuals = residuals_of(state, robot, sensor)
    misses = np.linalg.norm(residuals[:, 3:], axis=1)
    arm = math.sqrt(
        2.0 / 3.0 * float(np.mean(np.sum((used_sensor.translations_mm - centre) ** 2, axis=1)))
    )
    scale = np.tile(np.repeat([1.0 / max(arm, 1.0), 1.0], 3), 2)
    registration = RegistrationResult(
        transform=state.reference_from_base,
        residuals_mm=misses,
        fre_mm=math.sqrt(float(np.mean(misses[good] ** 2))),
        fle_mm=math.sqrt(3.0) * found.translation_mm,
        leave_one_out_mm=_leave_one_out(robot, sensor, good, state, found),
        covariance=covariance[:6, :6],
        condition=math.sqrt(float(np.linalg.cond(information * np.outer(scale, scale)))),
        accepted=False,
        reason="not judged at any target",
        method="robot_world",
        degrees_of_freedom=6 * int(good.sum()) - 12 if noise is None else None,
        outliers=tuple(np.flatnonzero(~good).tolist()),
    )
    targets = centre[None] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return RobotWorldResult(
        registration=judge(registration, targets, limits or AcceptanceLimits()),
        tip_from_sensor=state.tip_from_sensor,
        covariance=covariance,
        residuals_rad=np.linalg.norm(residuals[:, :3], axis=1),
        noise=found,
    )


def _check_turns(poses: PoseStack, what: str) -> None:
    turns = poses.relative_turns()
    largest = float(np.linalg.norm(turns, axis=1).max())
    if largest < MIN_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of {what} turn by {math.degrees(largest):.3g} degrees at most: "
            f"{math.degrees(MIN_TURN_RAD):g} wanted"
        )
    second = float(np.linalg.svd(turns, compute_uv=False)[1]) / math.sqrt(len(turns))
    if second < MIN_SECOND_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of {what} turn about parallel axes: {math.degrees(second):.3g} degrees RMS "
            f"about a second axis, {math.degrees(MIN_SECOND_TURN_RAD):g} wanted"
        )


def _agreeing(
    robot: PoseStack, sensor: PoseStack, noise: PoseNoise | None
) -> tuple[NDArray[np.bool_], tuple[RobotWorld, PoseNoise]]:
    """Which poses agree (n,), the estimate from them, and the noise that they show."""

    def start(mask: NDArray[np.bool_]) -> tuple[RobotWorld, PoseNoise]:
        state = closed_form(robot.of_poses(mask), sensor.of_poses(mask))
        return state, noise or NOMINAL_NOISE

    def refine(
        mask: NDArray[np.bool_], found: tuple[RobotWorld, PoseNoise]
    ) -> tuple[RobotWorld, PoseNoise]:
        used = robot.of_poses(mask), sensor.of_poses(mask)
        if noise is None:
            return with_estimated_noise(*used, *found)
        return maximum_likelihood(*used, noise, found[0]), noise

    def linearise(found: tuple[RobotWorld, PoseNoise]) -> tuple[FloatArray, FloatArray]:
        state, sigmas = found[0], found[1].sigmas
        residuals = residuals_of(state, robot, sensor)
        jacobian = jacobian_of(state, robot, residuals, sensor.translations_mm.mean(axis=0))
        return residuals / sigmas, jacobian / sigmas[:, None]

    return agreeing(
        len(robot.rotations),
        "pose pairs",
        draw=MIN_POSES,
        noise_known=noise is not None,
        start=start,
        refine=refine,
        linearise=linearise,
    )


def _leave_one_out(
    robot: PoseStack,
    sensor: PoseStack,
    good: NDArray[np.bool_],
    state: RobotWorld,
    noise: PoseNoise,
) -> FloatArray:
    """How far off each used sensor position is predicted from the other poses; NaN if dropped."""
    errors = np.full(len(good), np.nan)
    if good.sum() <= MIN_POSES:
        return errors
    for pose in np.flatnonzero(good):
        others = good.copy()
        others[pose] = False
        partial = maximum_likelihood(robot.of_poses(others), sensor.of_poses(others), noise, state)
        errors[pose] = np.linalg.norm(residuals_of(partial, robot, sensor)[pose, 3:])
    return errors


def _about_origin(about_centre: FloatArray, centre_mm: FloatArray) -> FloatArray:
    """A joint covariance (12, 12) whose base half was about ``centre_mm``, now about the origin."""
    change = np.eye(12)
    change[:6, :6] = origin_change(-centre_mm)
    return np.asarray(change @ about_centre @ change.T)
