"""Paired-point registration with its uncertainty."""

import math

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray
from app.registration.errors import CoincidentPointsError, CollinearPointsError
from app.registration.inputs import (
    MIN_POINTS,
    as_pairs,
    as_points,
    check_pair_geometry,
    check_spread,
)
from app.registration.motion import move_origin, point_jacobian
from app.registration.points.rigid_fit import PairNoise, fit_rigid
from app.registration.uncertainty.acceptance import AcceptanceLimits, evaluate_acceptance
from app.registration.uncertainty.result import RegistrationResult


def register_points(
    fixed_mm: ArrayLike,
    moving_mm: ArrayLike,
    *,
    fixed_frame: str,
    moving_frame: str,
    covariances_mm2: ArrayLike | None = None,
    moving_covariances_mm2: ArrayLike | None = None,
    targets_mm: ArrayLike | None = None,
    limits: AcceptanceLimits | None = None,
) -> RegistrationResult:
    """Compute ``fixed_from_moving`` from pairs of points (n, 3) in mm, n >= 3.

    ``covariances_mm2``, (3, 3) or (n, 3, 3) in mm2 in the fixed frame, is the localisation error
    of each pair; ``moving_covariances_mm2`` is a further part, given in the moving frame. Without
    both, the noise is isotropic and equal for all points and estimated from the fit:
    ``E[FRE^2] = (1 - 2/n) E[FLE^2]`` (Sibson 1979). ``targets_mm`` (m, 3) in the fixed frame are
    the points where the predicted error decides ``accepted``, e.g. of the tumour; the default is
    the fixed points.

    Raises a `RegistrationError` whose type names the cause: too few points, unequal counts,
    non-finite numbers, coincident, (nearly) collinear or mirrored points, different units, an
    invalid covariance.

    >>> import numpy as np
    >>> import marginguard as mg
    >>> truth = mg.Transform("reference", "robot_base", np.eye(3), [100.0, 0.0, 50.0])
    >>> in_base = np.array([[0, 0, 0], [90, 0, 0], [0, 80, 0], [0, 0, 70], [60, 60, 0]])
    >>> measured = truth.apply(in_base) + np.random.default_rng(1).normal(0.0, 0.2, (5, 3))
    >>> result = mg.register_points(
    ...     measured, in_base, fixed_frame="reference", moving_frame="robot_base"
    ... )
    >>> bool(result.transform.distance_mm_to(truth) < 0.5), result.accepted
    (True, True)
    """
    fixed, moving = as_pairs(fixed_mm, moving_mm)
    noise = PairNoise.from_covariances(covariances_mm2, moving_covariances_mm2, len(fixed))
    result = fit_registration(fixed, moving, noise, fixed_frame, moving_frame)
    targets = fixed if targets_mm is None else as_points(targets_mm, "targets_mm")
    return evaluate_acceptance(result, targets, limits or AcceptanceLimits())


def fit_registration(
    fixed: FloatArray,
    moving: FloatArray,
    noise: PairNoise | None,
    fixed_frame: str,
    moving_frame: str,
) -> RegistrationResult:
    """Return the result for finite pairs (n, 3), before the acceptance is evaluated."""
    check_pair_geometry(fixed, moving)
    transform = fit_rigid(fixed, moving, noise, fixed_frame, moving_frame)
    residuals = np.linalg.norm(fixed - transform.apply(moving), axis=1)
    fre = math.sqrt(float(np.mean(residuals**2)))
    if noise is None:
        scatter = np.broadcast_to(np.eye(3), (len(fixed), 3, 3))
        fle = fre / math.sqrt(1.0 - 2.0 / len(fixed))
        axis_variance = fle**2 / 3.0
    else:
        scatter = noise.total_mm2(transform.rotation)
        fle = math.sqrt(float(np.mean(np.trace(scatter, axis1=1, axis2=2))))
        axis_variance = 1.0
    unscaled, condition = _motion_covariance(fixed, scatter)
    return RegistrationResult(
        transform=transform,
        residuals_mm=residuals,
        fre_mm=fre,
        fle_mm=fle,
        leave_one_out_mm=_leave_one_out(fixed, moving, noise),
        covariance=axis_variance * unscaled,
        condition=condition,
        accepted=False,
        reason="acceptance is not evaluated",
        method="paired_points",
        degrees_of_freedom=3 * len(fixed) - 6 if noise is None else None,
    )


def _motion_covariance(fixed: FloatArray, scatter: FloatArray) -> tuple[FloatArray, float]:
    """Return the covariance (6, 6) about the origin and the condition number.

    ``scatter`` (n, 3, 3) are the covariances of the pairs.
    """
    centre = fixed.mean(axis=0)
    jacobian = point_jacobian(fixed - centre)
    information = np.swapaxes(jacobian, 1, 2) @ np.linalg.inv(scatter) @ jacobian
    total = np.sum(information, axis=0)
    # RMS distance from an axis through the centre, averaged over all directions of the axis.
    arm = math.sqrt(2.0 / 3.0 * float(np.mean(np.sum((fixed - centre) ** 2, axis=1))))
    scale = np.array([1.0 / arm] * 3 + [1.0] * 3)
    condition = math.sqrt(float(np.linalg.cond(total * np.outer(scale, scale))))
    return move_origin(np.linalg.inv(total), -centre), condition


def _leave_one_out(fixed: FloatArray, moving: FloatArray, noise: PairNoise | None) -> FloatArray:
    """Return the error (n,) of each point in a registration of the others, NaN where undefined."""
    errors = np.full(len(fixed), np.nan)
    if len(fixed) <= MIN_POINTS:
        return errors
    for point in range(len(fixed)):
        others = np.arange(len(fixed)) != point
        try:
            check_spread(fixed[others], "the other fixed points")
            check_spread(moving[others], "the other moving points")
        except (CoincidentPointsError, CollinearPointsError):
            continue  # the others determine no motion
        partial = fit_rigid(
            fixed[others],
            moving[others],
            None if noise is None else noise.select(others),
            "fixed",
            "moving",
        )
        errors[point] = np.linalg.norm(fixed[point] - partial.apply(moving[point]))
    return errors
