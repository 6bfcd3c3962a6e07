"""Paired-point registration with its uncertainty.

Isotropic noise that is equal for all points: closed form (Arun, Huang and Blostein 1987; Horn 1987;
Kabsch 1976). Other noise: maximum likelihood by Levenberg-Marquardt, started at the closed form.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray, Transform
from app.registration.input_checks import (
    MIN_POINTS,
    CoincidentPointsError,
    CollinearPointsError,
    ConvergenceError,
    MirroredPointsError,
    as_covariances,
    as_pairs,
    as_points,
    check_pair_geometry,
    check_spread,
)
from app.registration.registration_checks import AcceptanceLimits, evaluate_acceptance
from app.registration.registration_result import RegistrationResult
from app.registration.small_motion import apply_motion, least_squares, move_origin, point_jacobian

MAX_REFITS = 50
CONVERGED_RAD = 1e-12

MIRROR_RATIO = 3.0
"""Minimum ratio, for mirrored points, of the extent out of their best plane to the misfit of the
reflection. Flat landmarks are below it: a reflection at their plane is also a rigid motion."""

FLAT_RATIO = 1e-3
"""Points with a smaller ratio of the extent out of their plane to the extent within it are flat."""


@dataclass(frozen=True, slots=True, eq=False)
class PairNoise:
    """Covariances (n, 3, 3) in mm2 of the fixed and the moving points, each in its own frame."""

    fixed_mm2: FloatArray
    moving_mm2: FloatArray

    @classmethod
    def from_covariances(
        cls, fixed: ArrayLike | None, moving: ArrayLike | None, count: int
    ) -> "PairNoise | None":
        """Construct from covariances (3, 3) or (n, 3, 3); None if both are None."""
        if fixed is None and moving is None:
            return None
        zero = np.zeros((count, 3, 3))
        return cls(
            zero if fixed is None else as_covariances(fixed, count, "covariances_mm2"),
            zero if moving is None else as_covariances(moving, count, "moving_covariances_mm2"),
        )

    def total_mm2(self, rotation: FloatArray) -> FloatArray:
        """Covariance of the misfit of each pair in the fixed frame, (n, 3, 3)."""
        return self.fixed_mm2 + rotation @ self.moving_mm2 @ rotation.T

    def variances_mm2(self) -> FloatArray:
        """Variance (n,) of each pair, averaged over the axes; independent of the rotation."""
        return np.asarray(np.trace(self.fixed_mm2 + self.moving_mm2, axis1=1, axis2=2) / 3.0)

    def select(self, mask: NDArray[np.bool_]) -> "PairNoise":
        """Return the noise of the pairs of a mask (n,)."""
        return PairNoise(self.fixed_mm2[mask], self.moving_mm2[mask])


def fit_rigid(
    fixed: FloatArray,
    moving: FloatArray,
    noise: PairNoise | None,
    fixed_frame: str,
    moving_frame: str,
) -> Transform:
    """Compute ``fixed_from_moving`` from validated points (n, 3) in mm.

    Raises `MirroredPointsError` and `ConvergenceError`.
    """
    weights = np.ones(len(fixed)) if noise is None else 1.0 / noise.variances_mm2()
    start = _closed_form(fixed, moving, weights / weights.sum(), fixed_frame, moving_frame)
    return start if noise is None else _maximum_likelihood(fixed, moving, noise, start)


def _closed_form(
    fixed: FloatArray, moving: FloatArray, weights: FloatArray, fixed_frame: str, moving_frame: str
) -> Transform:
    fixed_centre, moving_centre = weights @ fixed, weights @ moving
    centred_fixed, centred_moving = fixed - fixed_centre, moving - moving_centre
    left, values, right = np.linalg.svd(centred_fixed.T @ (weights[:, None] * centred_moving))
    handedness = float(np.sign(np.linalg.det(left) * np.linalg.det(right)))
    if handedness < 0.0:
        mirror_misfit = np.linalg.norm(centred_fixed - centred_moving @ (left @ right).T, axis=1)
        rms = float(np.sqrt(weights @ mirror_misfit**2))
        out_of_plane = float(np.sqrt(values[2]))
        if out_of_plane > max(MIRROR_RATIO * rms, FLAT_RATIO * float(np.sqrt(values[0]))):
            raise MirroredPointsError(
                f"the {len(fixed)} moving points are a mirror image of the fixed ones: a "
                f"reflection fits within {rms:.3g} mm RMS and they extend {out_of_plane:.3g} mm "
                "out of their plane; expected points that a rigid motion maps"
            )
    rotation = left @ np.diag([1.0, 1.0, handedness]) @ right
    translation = fixed_centre - rotation @ moving_centre
    return Transform(fixed_frame, moving_frame, rotation, translation)


def _maximum_likelihood(
    fixed: FloatArray, moving: FloatArray, noise: PairNoise, start: Transform
) -> Transform:
    """Minimise the sum of ``r_i^T C_i^-1 r_i``, where the rotation changes ``C_i``, too."""
    centre = fixed.mean(axis=0)
    estimate = start
    for _ in range(MAX_REFITS):
        # The inverse Cholesky factor whitens the misfits.
        whiten = np.linalg.inv(np.linalg.cholesky(noise.total_mm2(estimate.rotation)))

        def linearise(
            state: Transform, whiten: FloatArray = whiten
        ) -> tuple[FloatArray, FloatArray]:
            mapped = state.apply(moving)
            misfit = np.einsum("nij,nj->ni", whiten, fixed - mapped)
            return misfit.ravel(), (whiten @ point_jacobian(mapped - centre)).reshape(-1, 6)

        before, estimate = (
            estimate,
            least_squares(
                estimate,
                linearise,
                lambda state, step: apply_motion(state, step, centre),
                "registration",
            ),
        )
        if not noise.moving_mm2.any() or before.angle_to(estimate) < CONVERGED_RAD:
            return estimate
    raise ConvergenceError(
        f"weights by the rotated covariances did not converge in {MAX_REFITS} fits"
    )


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
    check_pair_geometry(fixed, moving)
    transform = fit_rigid(fixed, moving, noise, fixed_frame, moving_frame)
    misfits = fixed - transform.apply(moving)
    residuals = np.linalg.norm(misfits, axis=1)
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
    result = RegistrationResult(
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
        degrees_of_freedom=_freedom(misfits) if noise is None else None,
    )
    targets = fixed if targets_mm is None else as_points(targets_mm, "targets_mm")
    return evaluate_acceptance(result, targets, limits or AcceptanceLimits())


def _freedom(misfits: FloatArray) -> int:
    """Degrees of freedom of the variance that is estimated from misfits (n, 3), at most 3n - 6.

    Fewer if the noise differs by direction, as that of a tracker does: those of a sum of three
    estimated variances (Satterthwaite, "An approximate distribution of estimates of variance
    components", 1946). Three misfits lie in a plane by construction and do not show it.
    """
    count = 3 * len(misfits) - 6
    scatter = misfits.T @ misfits
    square = float((scatter * scatter).sum())
    if len(misfits) == MIN_POINTS or square == 0.0:
        return count
    return max(1, round(count * float(np.trace(scatter)) ** 2 / (3.0 * square)))


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
