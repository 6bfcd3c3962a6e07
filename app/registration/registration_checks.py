"""Target registration error (TRE), acceptance by it, and drift of a registration.

First-order theory for any noise and weighting: a point ``p`` moves by ``J(p) m`` under the
small motion ``m`` between estimate and truth, so its error has covariance ``J C J^T`` (Danilchenko
and Fitzpatrick, "General approach to first-order error prediction in rigid point registration",
2011). With isotropic, equal noise it is the formula of Fitzpatrick, West and Maurer (1998):
``E[TRE^2] = E[FLE^2]/N (1 + 1/3 sum_k d_k^2 / f_k^2)``.

The fiducial registration error (FRE) says nothing about the target error of one registration
(Fitzpatrick 2009, "Fiducial registration error and target registration error are uncorrelated").
The criteria of acceptance are the predicted error at the targets, with a confidence bound for few
points, and the leave-one-out errors.

Drift is the difference between the tool's pose by the robot and its tracked pose. It shows a robot
base that was moved, a reference sensor that slipped, and metal in the EM field.
"""

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray, Transform
from app.registration.consensus import chi_square_quantile
from app.registration.input_checks import (
    MIN_POINTS,
    CovarianceError,
    ShapeError,
    TooFewError,
    as_covariances,
    as_points,
    check_positive,
    check_spread,
)
from app.registration.registration_result import RegistrationResult
from app.registration.small_motion import move_origin, point_jacobian


def predict_tre(result: RegistrationResult, points_mm: ArrayLike) -> FloatArray:
    """Return sigma (m,) in mm at points (m, 3) in mm in the fixed frame.

    Sigma is the 3-D root mean square of the error vector, an upper bound of the standard deviation
    along any direction. Raises `CovarianceError` for a registration without a covariance.

    The error grows with the distance from the landmarks:

    >>> import marginguard as mg
    >>> corners = [[0, 0, 0], [50, 0, 0], [0, 50, 0], [50, 50, 0]]
    >>> one_mm = [[1 / 3, 0, 0], [0, 1 / 3, 0], [0, 0, 1 / 3]]  # FLE of 1 mm
    >>> result = mg.register_points(
    ...     corners, corners, fixed_frame="reference", moving_frame="robot_base",
    ...     covariances_mm2=one_mm,
    ... )
    >>> mg.predict_tre(result, [[25, 25, 0], [25, 25, 200]]).round(2).tolist()
    [0.5, 3.3]
    """
    points = as_points(points_mm, "points_mm of a target error")
    variances = load_tre_kernel().variance_mm2(*_trace_terms(result), *points.T)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def largest_tre(
    result: RegistrationResult,
    fixed_from_tip: Transform,
    points_from_tip: Transform,
    points_mm: FloatArray,
) -> float:
    """The largest of `predict_tre` in mm at the tip of a tool and at points, without checks.

    ``points_mm`` (m, 3) are in the frame of ``points_from_tip``. Without a covariance it raises as
    `predict_tre`.
    """
    variance_mm2 = load_tre_kernel().largest_variance_mm2(
        *_trace_terms(result),
        fixed_from_tip.rotation,
        fixed_from_tip.translation_mm,
        points_from_tip.rotation,
        points_from_tip.translation_mm,
        points_mm.copy(),  # compiled code is specialised on the layout
    )
    return math.sqrt(max(variance_mm2, 0.0))


@cache
def load_tre_kernel() -> ModuleType:
    """The compiled error, loaded with the compiler and run once: a step must not wait for it."""
    from app.registration import tre_kernel

    tip = Transform.identity("fixed", "tip")
    pose = tip.rotation, tip.translation_mm
    tre_kernel.largest_variance_mm2(
        np.zeros((3, 3)), np.zeros(3), 0.0, *pose, *pose, np.zeros((1, 3))
    )
    return tre_kernel


def tre_growth(result: RegistrationResult) -> float:
    """Largest increase of `predict_tre` per mm between two points; 0 without a covariance.

    The errors of two points differ by the small rotation times their difference; a root mean
    square is at most the sum of those of its parts (Minkowski).
    """
    if result.covariance is None:
        return 0.0
    return math.sqrt(max(float(np.linalg.eigvalsh(_trace_terms(result)[0])[-1]), 0.0))


@lru_cache(maxsize=16)  # called in every step of a session, which has one registration
def _trace_terms(result: RegistrationResult) -> tuple[FloatArray, FloatArray, float]:
    """Return A, b, c with the trace of ``J C J^T`` at a point p equal to ``p A p - 2 b p + c``."""
    covariance = _known_covariance(result)
    rotation, mixed, translation = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    linear = [mixed[1, 2] - mixed[2, 1], mixed[2, 0] - mixed[0, 2], mixed[0, 1] - mixed[1, 0]]
    quadratic = rotation.trace() * np.eye(3) - rotation
    return quadratic, np.array(linear), float(translation.trace())


def tre_covariances(result: RegistrationResult, points_mm: ArrayLike) -> FloatArray:
    """Return covariances (m, 3, 3) in mm2 of the error at points (m, 3) in the fixed frame."""
    covariance = _known_covariance(result)
    return _at_points(covariance, as_points(points_mm, "points_mm of a target error"))


def tre_upper_bound(
    result: RegistrationResult, points_mm: ArrayLike, *, confidence: float = 0.95
) -> FloatArray:
    """Return an upper confidence bound (m,) in mm of sigma at points (m, 3).

    Equal to `predict_tre` if the noise was given. Otherwise the noise was estimated from residuals
    and may be too small by chance; the bound is the one-sided chi-square bound on its variance.
    Three points have 3 degrees of freedom and a bound of 2.9 times the estimate.
    """
    if not 0.5 <= confidence < 1.0:
        raise ShapeError(f"confidence is {confidence}; expected 0.5 to below 1")
    sigma = predict_tre(result, points_mm)
    dof = result.degrees_of_freedom
    if dof is None:
        return sigma
    return np.asarray(sigma * math.sqrt(dof / chi_square_quantile(1.0 - confidence, dof)))


def predict_layout_tre(
    landmarks_mm: ArrayLike,
    targets_mm: ArrayLike,
    covariances_mm2: ArrayLike,
    *,
    matched_weights: bool,
) -> FloatArray:
    """Return sigma (m,) in mm at ``targets_mm`` (m, 3) for a planned registration.

    ``landmarks_mm`` (n, 3) are in the same frame; ``covariances_mm2`` (3, 3) or (n, 3, 3) is the
    localisation error of the pairs. With ``matched_weights`` the registration will be weighted by
    these covariances, as `register_points` does if it gets them; otherwise all points will have
    equal weights. Raises a `RegistrationError` for landmarks that `register_points` rejects.
    """
    landmarks = as_points(landmarks_mm, "landmarks_mm")
    if len(landmarks) < MIN_POINTS:
        raise TooFewError(f"{len(landmarks)} landmarks; expected at least {MIN_POINTS}")
    check_spread(landmarks, "landmarks_mm")
    targets = as_points(targets_mm, "targets_mm")
    covariances = as_covariances(covariances_mm2, len(landmarks), "covariances_mm2")
    centre = landmarks.mean(axis=0)
    jacobian = point_jacobian(landmarks - centre)
    weights = np.linalg.inv(covariances) if matched_weights else np.eye(3)[None]
    weighted = np.einsum("nki,nkl->nil", jacobian, np.broadcast_to(weights, covariances.shape))
    gain = np.linalg.solve(np.einsum("nik,nkj->ij", weighted, jacobian), np.hstack(list(weighted)))
    gains = gain.reshape(6, len(landmarks), 3)
    about_centre = np.einsum("ink,nkl,jnl->ij", gains, covariances, gains)
    covariance = _at_points(move_origin(about_centre, -centre), targets)
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


def _known_covariance(result: RegistrationResult) -> FloatArray:
    if result.covariance is None:
        raise CovarianceError(
            f"uncertainty of a {result.method!r} registration is not known; "
            "expected a registration with a covariance"
        )
    return result.covariance


def _at_points(covariance: FloatArray, points_mm: FloatArray) -> FloatArray:
    jacobian = point_jacobian(points_mm)
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))


# The criteria are the predicted error at the targets, with a confidence bound for few points, and
# the leave-one-out errors.


@dataclass(frozen=True, slots=True)
class AcceptanceLimits:
    """Limits in mm of the 95 % upper bound of sigma TRE and of every leave-one-out error.

    The defaults are for EM tracking of soft tissue. In an undistorted field EM tracking is accurate
    to about 1 mm in an operating room, so a leave-one-out error of 5 mm is a gross error.
    """

    tre_mm: float = 2.0
    leave_one_out_mm: float = 5.0

    def __post_init__(self) -> None:
        check_positive(self.tre_mm, "tre_mm of the acceptance limits")
        check_positive(self.leave_one_out_mm, "leave_one_out_mm of the acceptance limits")


def evaluate_acceptance(
    result: RegistrationResult, targets_mm: ArrayLike, limits: AcceptanceLimits
) -> RegistrationResult:
    """Return ``result`` with ``accepted`` and ``reason`` for targets (m, 3) in mm.

    The targets are in the fixed frame. Raises `CovarianceError` for a registration without a
    covariance.
    """
    if result.covariance is None:
        raise CovarianceError(
            f"acceptance of a {result.method!r} registration cannot be evaluated; "
            "expected a registration with a covariance"
        )
    targets = as_points(targets_mm, "targets_mm")
    bounds = tre_upper_bound(result, targets)
    worst = int(np.argmax(bounds))
    details = [
        f"predicted TRE is at most {bounds[worst]:.3g} mm RMS (95 %) at the worst of "
        f"{len(targets)} targets"
    ]
    faults = []
    # `not <=` also rejects NaN, which `argmax` returns first.
    if not bounds[worst] <= limits.tre_mm:
        faults.append(
            f"predicted TRE may be {bounds[worst]:.3g} mm RMS (95 %) at target {worst} "
            f"({', '.join(f'{x:.1f}' for x in targets[worst])}); "
            f"expected at most {limits.tre_mm:g} mm"
        )
    leave_one_out = result.leave_one_out_mm
    if np.isfinite(leave_one_out).any():
        point = int(np.nanargmax(leave_one_out))
        details.append(f"leave-one-out error is at most {leave_one_out[point]:.3g} mm")
        if leave_one_out[point] > limits.leave_one_out_mm:
            faults.append(
                f"leave-one-out error of point {point} is {leave_one_out[point]:.3g} mm; "
                f"expected at most {limits.leave_one_out_mm:g} mm"
            )
    else:
        details.append("leave-one-out error is not available")
    return replace(result, accepted=not faults, reason="; ".join(faults or details))


# Detects a robot base that was moved, a reference sensor that slipped, and metal in the EM field.


@dataclass(frozen=True, slots=True)
class DriftBound:
    """Largest difference between predicted and measured pose that counts as noise."""

    translation_mm: float
    rotation_rad: float

    def __post_init__(self) -> None:
        check_positive(self.translation_mm, "translation_mm of a drift bound")
        check_positive(self.rotation_rad, "rotation_rad of a drift bound")


@dataclass(frozen=True, slots=True)
class RegistrationDrift:
    """Difference between two poses of ``frame``, and its bound."""

    frame: str
    translation_mm: float
    rotation_rad: float
    bound: DriftBound

    @property
    def accepted(self) -> bool:
        """True if translation and rotation are within the bound."""
        return bool(
            self.translation_mm <= self.bound.translation_mm
            and self.rotation_rad <= self.bound.rotation_rad
        )

    @property
    def reason(self) -> str:
        """One line that describes the difference and the bound."""
        return (
            f"{self.frame} is {self.translation_mm:.3g} mm and "
            f"{math.degrees(self.rotation_rad):.3g} degrees from its pose by the registration; "
            f"expected at most {self.bound.translation_mm:g} mm and "
            f"{math.degrees(self.bound.rotation_rad):.3g} degrees"
        )
