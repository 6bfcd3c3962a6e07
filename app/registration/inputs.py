"""Points and covariances as they come in: copied, checked, refused by the type of their fault."""

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import FloatArray
from app.registration.errors import (
    CoincidentPointsError,
    CollinearPointsError,
    CovarianceError,
    NotFiniteError,
    ScaleMismatchError,
    ShapeError,
    TooFewError,
    UnequalCountsError,
)

MIN_POINTS = 3

COINCIDENT_MM = 0.01
"""Points whose RMS distance from their centre is below this are one point to any tracker."""

COLLINEAR_RATIO = 0.05
"""Smallest allowed RMS distance from the best line over the RMS distance along it.

Relative, because a metre of landmarks that swerve by a centimetre fixes the turn about their line
no better than a decimetre that swerves by a millimetre does for targets at the same distance in
proportion. At 0.05 an error across the line is magnified twentyfold at one spread from it."""

SIGMAS_MM = (1e-6, 1e6)
"""Standard deviations of a point that mean something: beyond them a fit is of rounding."""

MAX_SCALE_RATIO = 2.0
"""Lists of the same landmarks that differ in size by more than this are in different units."""


def as_points(values: ArrayLike, what: str) -> FloatArray:
    """Finite points (n, 3), n > 0, as a new array."""
    points = as_floats(values, what)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ShapeError(f"{what} has shape {points.shape}: (n, 3) with n > 0 wanted")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        first = int(np.argmin(finite))
        raise NotFiniteError(
            f"point {first} of {what} is {points[first].tolist()}: finite numbers wanted "
            f"({int((~finite).sum())} of {len(points)} are not)"
        )
    return points


def as_point(values: ArrayLike, what: str) -> FloatArray:
    """One finite point or direction (3,), as a new array."""
    point = as_floats(values, what)
    if point.shape != (3,):
        raise ShapeError(f"{what} has shape {point.shape}: (3,) wanted")
    if not np.isfinite(point).all():
        raise NotFiniteError(f"{what} is {point.tolist()}: finite numbers wanted")
    return point


def as_floats(values: ArrayLike, what: str) -> FloatArray:
    """A new float array, or `ShapeError` when these are no numbers or a ragged list."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{what} is not an array of numbers: {error}") from error


def as_pairs(fixed_mm: ArrayLike, moving_mm: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Two lists (n, 3), n >= 3, of finite points, one moving point for each fixed one."""
    fixed = as_points(fixed_mm, "fixed_mm")
    moving = as_points(moving_mm, "moving_mm")
    if len(fixed) != len(moving):
        raise UnequalCountsError(
            f"fixed_mm has {len(fixed)} points and moving_mm {len(moving)}: "
            "one moving point for each fixed one wanted"
        )
    if len(fixed) < MIN_POINTS:
        raise TooFewError(f"{len(fixed)} point pairs: at least {MIN_POINTS} wanted")
    return fixed, moving


def check_pair_geometry(fixed: FloatArray, moving: FloatArray) -> None:
    """Refuse pairs (n, 3) that fix no rigid motion, or that are in different units."""
    sizes = check_spread(fixed, "fixed_mm"), check_spread(moving, "moving_mm")
    ratio = sizes[0] / sizes[1]
    if not 1.0 / MAX_SCALE_RATIO <= ratio <= MAX_SCALE_RATIO:
        raise ScaleMismatchError(
            f"fixed_mm spreads over {sizes[0]:.6g} mm RMS and moving_mm over {sizes[1]:.6g} mm: "
            f"a ratio of at most {MAX_SCALE_RATIO} wanted (are both in mm?)"
        )


def check_spread(points_mm: FloatArray, what: str) -> float:
    """RMS distance in mm from the centre; refuses coincident and (nearly) collinear points."""
    centred = points_mm - points_mm.mean(axis=0)
    along, across = np.linalg.svd(centred, compute_uv=False)[:2] / np.sqrt(len(points_mm))
    spread = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    if spread < COINCIDENT_MM:
        raise CoincidentPointsError(
            f"the {len(points_mm)} points of {what} coincide: they spread over {spread:.3g} mm "
            f"RMS, at least {COINCIDENT_MM} wanted"
        )
    if across < COLLINEAR_RATIO * along:
        raise CollinearPointsError(
            f"the {len(points_mm)} points of {what} are collinear: {across:.3g} mm RMS across "
            f"their line against {along:.3g} mm along it, a ratio of {COLLINEAR_RATIO} wanted"
        )
    return spread


def as_covariances(values: ArrayLike, count: int, what: str) -> FloatArray:
    """One covariance (3, 3) for all points or (count, 3, 3), in mm2, positive definite.

    The standard deviation along each of its axes is within `SIGMAS_MM`.
    """
    given = as_floats(values, what)
    if given.shape not in ((3, 3), (count, 3, 3)):
        raise ShapeError(f"{what} has shape {given.shape}: (3, 3) or ({count}, 3, 3) wanted")
    if not np.isfinite(given).all():
        raise NotFiniteError(f"{what} holds numbers that are not finite")
    covariances = np.broadcast_to(given, (count, 3, 3)).copy()
    eigenvalues = np.linalg.eigvalsh(covariances)
    asymmetry = np.abs(covariances - np.swapaxes(covariances, 1, 2)).max(axis=(1, 2))
    least, most = (sigma**2 for sigma in SIGMAS_MM)
    bad = (eigenvalues[:, 0] < least) | (eigenvalues[:, 2] > most)
    bad |= asymmetry > 1e-9 * eigenvalues[:, 2]
    if bad.any():
        first = int(np.argmax(bad))
        raise CovarianceError(
            f"covariance {first} of {what} is {covariances[first].tolist()}: "
            "symmetric and positive definite wanted, with standard deviations from "
            f"{SIGMAS_MM[0]:g} to {SIGMAS_MM[1]:g} mm"
        )
    return covariances
