"""Errors of registrations and calibrations, one type per cause, and checks of their input.

An error is never replaced by a default result: there is no transform then.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray, MarginGuardError


class RegistrationError(MarginGuardError):
    """Base class of the errors of this package."""


class TooFewError(RegistrationError):
    """Fewer points, poses or samples than the unknowns require."""


class NoValidSamplesError(TooFewError):
    """No sample has status OK."""


class UnequalCountsError(RegistrationError):
    """Lists of pairs have different lengths."""


class NotFiniteError(RegistrationError):
    """A coordinate, a covariance or a time is NaN or infinite."""


class ShapeError(RegistrationError):
    """An array has the wrong shape, or a number is out of range."""


class CoincidentPointsError(RegistrationError):
    """All points coincide: no rotation can be found."""


class CollinearPointsError(RegistrationError):
    """The points lie on or close to a line: the rotation about it is undetermined."""


class MirroredPointsError(RegistrationError):
    """One point set is the mirror image of the other: no rigid motion maps them."""


class ScaleMismatchError(RegistrationError):
    """The extents of two point sets differ so much that their units must differ."""


class CovarianceError(RegistrationError):
    """A covariance is not symmetric and positive definite, or is not known."""


class DegenerateMotionError(RegistrationError):
    """Poses rotate too little or about one axis only: part of the result is undetermined."""


class NoConsensusError(RegistrationError):
    """Too few observations agree, or two groups agree on different results."""


class ConvergenceError(RegistrationError):
    """An iteration did not converge."""


class FlatSignalError(RegistrationError):
    """A signal changes too little to be aligned in time."""


MIN_POINTS = 3

COINCIDENT_MM = 0.01
"""Points with a smaller RMS distance from their centre count as coincident."""

COLLINEAR_RATIO = 0.05
"""Minimum ratio of the RMS distance across the best line to the RMS distance along it.

The ratio and not the distance determines how well the rotation about the line is known at targets
in proportion to the landmarks. At 0.05 an error across the line is magnified 20 times at one
spread from it."""

SIGMAS_MM = (1e-6, 1e6)
"""Allowed standard deviations of a point; outside them rounding dominates the fit."""

MAX_SCALE_RATIO = 2.0
"""Maximum ratio of the extents of two lists of the same landmarks; beyond it the units differ."""


def check_positive(value: float, what: str) -> None:
    """Raise `ShapeError` unless ``value`` is a finite number above 0."""
    if not (math.isfinite(value) and value > 0.0):
        raise ShapeError(f"{what} is {value}; expected a finite number above 0")


def as_points(values: ArrayLike, what: str) -> FloatArray:
    """Return a new array of finite points (n, 3), n > 0."""
    points = as_floats(values, what)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ShapeError(f"{what} has shape {points.shape}; expected (n, 3) with n > 0")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        first = int(np.argmin(finite))
        raise NotFiniteError(
            f"point {first} of {what} is {points[first].tolist()}; expected finite numbers "
            f"({int((~finite).sum())} of {len(points)} are not)"
        )
    return points


def as_point(values: ArrayLike, what: str) -> FloatArray:
    """Return a new array of one finite point or direction (3,)."""
    point = as_floats(values, what)
    if point.shape != (3,):
        raise ShapeError(f"{what} has shape {point.shape}; expected (3,)")
    if not np.isfinite(point).all():
        raise NotFiniteError(f"{what} is {point.tolist()}; expected finite numbers")
    return point


def as_floats(values: ArrayLike, what: str) -> FloatArray:
    """Return a new float array; raise `ShapeError` for a ragged list and other types."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(
            f"{what} is not an array of numbers ({error}); expected an array of numbers"
        ) from error


def as_pairs(fixed_mm: ArrayLike, moving_mm: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return two arrays (n, 3), n >= 3, of finite points, one moving point per fixed point."""
    fixed = as_points(fixed_mm, "fixed_mm")
    moving = as_points(moving_mm, "moving_mm")
    if len(fixed) != len(moving):
        raise UnequalCountsError(
            f"fixed_mm has {len(fixed)} points and moving_mm {len(moving)}; "
            "expected one moving point per fixed point"
        )
    if len(fixed) < MIN_POINTS:
        raise TooFewError(f"{len(fixed)} point pairs; expected at least {MIN_POINTS}")
    return fixed, moving


def check_pair_geometry(fixed: FloatArray, moving: FloatArray) -> None:
    """Raise an error for pairs (n, 3) that determine no rigid motion or differ in their units."""
    sizes = check_spread(fixed, "fixed_mm"), check_spread(moving, "moving_mm")
    ratio = sizes[0] / sizes[1]
    if not 1.0 / MAX_SCALE_RATIO <= ratio <= MAX_SCALE_RATIO:
        raise ScaleMismatchError(
            f"fixed_mm spreads over {sizes[0]:.6g} mm RMS and moving_mm over {sizes[1]:.6g} mm; "
            f"expected a ratio of at most {MAX_SCALE_RATIO} (are both in mm?)"
        )


def check_spread(points_mm: FloatArray, what: str) -> float:
    """Return the RMS distance in mm from the centre.

    Raises `CoincidentPointsError` and, for points on or close to a line, `CollinearPointsError`.
    """
    centred = points_mm - points_mm.mean(axis=0)
    along, across = np.linalg.svd(centred, compute_uv=False)[:2] / np.sqrt(len(points_mm))
    spread = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    if spread < COINCIDENT_MM:
        raise CoincidentPointsError(
            f"the {len(points_mm)} points of {what} coincide: they spread over {spread:.3g} mm "
            f"RMS; expected at least {COINCIDENT_MM} mm"
        )
    if across < COLLINEAR_RATIO * along:
        raise CollinearPointsError(
            f"the {len(points_mm)} points of {what} are collinear: {across:.3g} mm RMS across "
            f"their line against {along:.3g} mm along it; "
            f"expected a ratio of at least {COLLINEAR_RATIO}"
        )
    return spread


def as_covariances(values: ArrayLike, count: int, what: str) -> FloatArray:
    """Return covariances (count, 3, 3) in mm2 from one (3, 3) for all points or (count, 3, 3).

    Raises `CovarianceError` unless each is symmetric and positive definite with standard
    deviations within `SIGMAS_MM` along its axes.
    """
    given = as_floats(values, what)
    if given.shape not in ((3, 3), (count, 3, 3)):
        raise ShapeError(f"{what} has shape {given.shape}; expected (3, 3) or ({count}, 3, 3)")
    if not np.isfinite(given).all():
        raise NotFiniteError(f"{what} has entries that are not finite; expected finite numbers")
    covariances = np.broadcast_to(given, (count, 3, 3)).copy()
    eigenvalues = np.linalg.eigvalsh(covariances)
    asymmetry = np.abs(covariances - np.swapaxes(covariances, 1, 2)).max(axis=(1, 2))
    min_variance, max_variance = (sigma**2 for sigma in SIGMAS_MM)
    bad = (eigenvalues[:, 0] < min_variance) | (eigenvalues[:, 2] > max_variance)
    bad |= asymmetry > 1e-9 * eigenvalues[:, 2]
    if bad.any():
        first = int(np.argmax(bad))
        raise CovarianceError(
            f"covariance {first} of {what} is {covariances[first].tolist()}; "
            "expected a symmetric, positive definite matrix with standard deviations from "
            f"{SIGMAS_MM[0]:g} to {SIGMAS_MM[1]:g} mm"
        )
    return covariances
