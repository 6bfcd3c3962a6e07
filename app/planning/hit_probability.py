"""Probability that a straight needle hits a structure, with a bound of its error.

Assumed is a normal error of the needle's place, the same along the whole needle: it moves parallel
to itself. The part of the error along the needle is left out, because a stop sets the depth, and
turns are left out: give the error at the target, where they are largest. The surface of the
structure moves along its normal by a normal error of its own, independent of the first.
"""

import numpy as np
from scipy.special import ndtr

from app.fixture.surfaces.surface import Surface
from app.geometry import FloatArray, InputError
from app.planning.corridor_distance import needle_distances

MAX_ERROR = 0.003
"""Largest error of a probability, certain for a structure whose surface has no error.

With one, cells are divided to a quarter of its standard deviation, where the integrand is smooth.
"""

_REACH = 4.5
"""Errors beyond this many standard deviations, a share below 2e-5, are left out."""

_KEPT = float(ndtr(_REACH) - ndtr(-_REACH)) ** 2

_FIRST_CELLS = 6
_MAX_SIGMA_MM = 1000.0
_CORNERS = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
_MAX_LEVELS = 20
_FINEST_MM = 1e-3
"""Least tolerance of a depth."""


def hit_probability(
    surface: Surface,
    start_mm: FloatArray,
    end_mm: FloatArray,
    *,
    radius_mm: float,
    covariance_mm2: FloatArray,
    sigma_mm: float,
) -> float:
    """Probability that a needle of ``radius_mm`` from ``start_mm`` to ``end_mm``, (3,) each, hits.

    ``covariance_mm2`` (3, 3) is that of the needle's place, ``sigma_mm`` the standard deviation of
    the surface. The two lateral errors are integrated over cells that are divided until the result
    is known within `MAX_ERROR`: a shift of the needle changes its distance by at most its length,
    so the distance at the centre of a cell bounds all distances in it.
    """
    basis = np.linalg.svd((end_mm - start_mm)[None])[2][1:]  # across the needle
    variances, turn = np.linalg.eigh(basis @ covariance_mm2 @ basis.T)
    # Row k is the shift in mm by one standard deviation of the lateral error k.
    sigmas_mm = np.sqrt(np.maximum(variances, 0.0))
    shifts = sigmas_mm[:, None] * (turn.T @ basis)
    half = np.full(2, _REACH / _FIRST_CELLS)  # of the sides of a cell, in standard deviations
    ticks = (2.0 * np.arange(_FIRST_CELLS) + 1.0) * half[0] - _REACH
    centers = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    probability = settled_doubt = 0.0
    for level in range(_MAX_LEVELS + 1):
        offsets = centers @ shifts
        spread_mm = float(np.linalg.norm(half * sigmas_mm))
        depth_mm = max(0.1 * spread_mm, _FINEST_MM)  # tolerance of a negative distance
        axis_mm = needle_distances(
            surface, start_mm + offsets, end_mm + offsets, tolerance_mm=depth_mm
        )
        distance_mm = axis_mm - radius_mm
        lowest_mm = distance_mm - spread_mm - np.where(axis_mm <= 0.0, depth_mm, 0.0)
        share = np.prod(ndtr(centers + half) - ndtr(centers - half), axis=1) / _KEPT
        value = share * _hit_share(distance_mm, sigma_mm)
        doubt = np.maximum(
            share * _hit_share(lowest_mm, sigma_mm) - value,
            value - share * _hit_share(distance_mm + spread_mm, sigma_mm),
        )
        # The cells with the smallest doubts are settled: together they stay within the bound.
        order = np.argsort(doubt)
        allowed = 0.5 * MAX_ERROR / (level + 1) ** 2
        count = int(np.searchsorted(np.cumsum(doubt[order]), allowed, side="right"))
        if spread_mm <= sigma_mm / 4.0 or settled_doubt + float(doubt.sum()) <= MAX_ERROR:
            return min(probability + float(value.sum()), 1.0)
        probability += float(value[order[:count]].sum())
        settled_doubt += float(doubt[order[:count]].sum())
        # Only the longer sides in mm are halved, so that the cells become square.
        is_long = half * sigmas_mm > 0.5 * (half * sigmas_mm).max()
        half = np.where(is_long, 0.5 * half, half)
        corners = np.unique(np.where(is_long, half, 0.0) * _CORNERS, axis=0)
        centers = (centers[order[count:], None] + corners).reshape(-1, 2)
    # The upper bound, where so many divisions have left a doubt.
    return min(probability + float((value + doubt)[order[count:]].sum()), 1.0)


def covariance_of(error: float | FloatArray) -> FloatArray:
    """The covariance (3, 3) in mm2 of ``error``: one, or a standard deviation along each axis.

    Raises `InputError` for other values.
    """
    given = np.asarray(error, dtype=np.float64)
    if given.shape == () and 0.0 <= given <= _MAX_SIGMA_MM:
        return np.asarray(np.eye(3) * given**2)
    is_symmetric = (
        given.shape == (3, 3)
        and (np.abs(given) <= _MAX_SIGMA_MM**2).all()  # false for NaN
        and np.allclose(given, given.T)
    )
    if is_symmetric and np.linalg.eigvalsh(given)[0] >= -1e-9 * max(1.0, float(np.trace(given))):
        return given
    raise InputError(
        f"error of the needle: is {' '.join(str(error).split())}; expected a standard deviation "
        f"of 0 to {_MAX_SIGMA_MM:g} mm, or a covariance (3, 3) in mm2"
    )


def _hit_share(distance_mm: FloatArray, sigma_mm: float) -> FloatArray:
    """Probability that a surface at ``distance_mm`` is moved onto the needle."""
    if sigma_mm > 0.0:
        return np.asarray(ndtr(-distance_mm / sigma_mm))
    return np.asarray(distance_mm <= 0.0, dtype=np.float64)
