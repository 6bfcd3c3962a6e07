"""Target registration error: how far off a registered point is, to be expected.

First-order theory for any noise and any weighting: a point ``p`` moves by ``J(p) m`` under the
small motion ``m`` between estimate and truth, so its error has covariance ``J C J^T`` (Danilchenko
and Fitzpatrick, "General approach to first-order error prediction in rigid point registration",
2011). With isotropic, equal noise it is the formula of Fitzpatrick, West and Maurer (1998):
``E[TRE^2] = E[FLE^2]/N (1 + 1/3 sum_k d_k^2 / f_k^2)``.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray
from app.registration.errors import CovarianceError, ShapeError, TooFewError
from app.registration.inputs import (
    MIN_POINTS,
    as_covariances,
    as_point,
    as_points,
    check_spread,
)
from app.registration.motion import move_origin, point_jacobian
from app.registration.quantiles import chi_square_quantile
from app.registration.uncertainty.result import RegistrationResult


def predict_tre(result: RegistrationResult, points_mm: ArrayLike) -> FloatArray:
    """Sigma in mm, (m,), at points (m, 3) in mm in the fixed frame.

    Sigma is the 3-D root mean square of the error vector, so it is never below the standard
    deviation along any single direction. Raises `CovarianceError` for a registration whose
    uncertainty is not known (a given one).
    """
    spread, lever, shift = _trace_terms(result)
    points = as_points(points_mm, "points_mm of a target error")
    variance = (points.dot(spread) * points).sum(axis=1) - 2.0 * points.dot(lever) + shift
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def tre_at(result: RegistrationResult, point_mm: FloatArray) -> float:
    """As `predict_tre`, at one point (3,): for what asks at every step."""
    spread, lever, shift = _trace_terms(result)
    variance = float(point_mm.dot(spread).dot(point_mm) - 2.0 * point_mm.dot(lever) + shift)
    if not math.isfinite(variance):
        as_point(point_mm, "point_mm of a target error")
    return math.sqrt(max(variance, 0.0))


@lru_cache(maxsize=16)  # asked at every step of a session, which has one registration
def _trace_terms(result: RegistrationResult) -> tuple[FloatArray, FloatArray, float]:
    """The trace of J C J^T at a point p, written out: ``p A p - 2 b p + c``, as A, b and c."""
    covariance = _known_covariance(result)
    turn, mixed, shift = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    lever = [mixed[1, 2] - mixed[2, 1], mixed[2, 0] - mixed[0, 2], mixed[0, 1] - mixed[1, 0]]
    return turn.trace() * np.eye(3) - turn, np.array(lever), float(shift.trace())


def tre_covariances(result: RegistrationResult, points_mm: ArrayLike) -> FloatArray:
    """Covariance in mm2, (m, 3, 3), of the error at points (m, 3) in the fixed frame."""
    covariance = _known_covariance(result)
    return _at_points(covariance, as_points(points_mm, "points_mm of a target error"))


def tre_upper_bound(
    result: RegistrationResult, points_mm: ArrayLike, *, confidence: float = 0.95
) -> FloatArray:
    """What sigma in mm, (m,), is not above, with ``confidence``, at points (m, 3).

    Equal to `predict_tre` where the noise was handed in. Where it was estimated from the residuals
    of a few points the estimate may be small by luck: three points have 3 degrees of freedom, and
    their bound is 2.9 times the estimate. One-sided chi-square bound on the noise variance.
    """
    if not 0.5 <= confidence < 1.0:
        raise ShapeError(f"confidence {confidence} is not within 0.5 and 1")
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
    """Sigma in mm, (m,), at ``targets_mm`` (m, 3) before a registration is done: for planning.

    ``landmarks_mm`` (n, 3) in the same frame; ``covariances_mm2`` (3, 3) or (n, 3, 3) in mm2 is
    the localisation error of the pairs. ``matched_weights``: the registration will be weighted by
    these covariances, as `register_points` does when it gets them; otherwise it will treat all
    points alike. Raises a `RegistrationError` for landmarks that would be refused by it.
    """
    landmarks = as_points(landmarks_mm, "landmarks_mm")
    if len(landmarks) < MIN_POINTS:
        raise TooFewError(f"{len(landmarks)} landmarks: at least {MIN_POINTS} wanted")
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
            f"the uncertainty of a {result.method!r} registration is not known: "
            "no target error can be predicted from it"
        )
    return result.covariance


def _at_points(covariance: FloatArray, points_mm: FloatArray) -> FloatArray:
    jacobian = point_jacobian(points_mm)
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))
