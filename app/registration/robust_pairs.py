"""Robust paired-point registration that rejects wrong pairs.

Consensus over triples (RANSAC, Fischler and Bolles 1981, scored as in MSAC, Torr and Zisserman
2000). All triples are tried up to `MAX_TRIPLES`, beyond it a sample with a fixed seed, so results
are reproducible.
"""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray
from app.registration.input_checks import (
    COLLINEAR_RATIO,
    MIN_POINTS,
    NoConsensusError,
    ShapeError,
    as_pairs,
    as_points,
)
from app.registration.paired_points import PairNoise, fit_registration
from app.registration.registration_checks import AcceptanceLimits, evaluate_acceptance
from app.registration.registration_result import RegistrationResult

MAX_TRIPLES = 4000
MAX_REFITS = 20


def register_points_robust(
    fixed_mm: ArrayLike,
    moving_mm: ArrayLike,
    *,
    fixed_frame: str,
    moving_frame: str,
    inlier_mm: float,
    covariances_mm2: ArrayLike | None = None,
    moving_covariances_mm2: ArrayLike | None = None,
    targets_mm: ArrayLike | None = None,
    limits: AcceptanceLimits | None = None,
) -> RegistrationResult:
    """Register points like `register_points`, but reject pairs with residuals above ``inlier_mm``.

    ``inlier_mm`` is about three times the localisation error. Raises `NoConsensusError` unless more
    than half of the pairs, and at least three, agree on one motion, and no other group of that
    size agrees on another one. The result has residuals of all pairs, and NaN as leave-one-out
    error of the outliers.
    """
    if not (math.isfinite(inlier_mm) and inlier_mm > 0.0):
        raise ShapeError(f"inlier_mm is {inlier_mm}; expected a finite number above 0")
    fixed, moving = as_pairs(fixed_mm, moving_mm)
    noise = PairNoise.from_covariances(covariances_mm2, moving_covariances_mm2, len(fixed))
    inliers = largest_consistent_group(fixed, moving, inlier_mm)
    for _ in range(MAX_REFITS):
        result = fit_registration(
            fixed[inliers],
            moving[inliers],
            None if noise is None else noise.select(inliers),
            fixed_frame,
            moving_frame,
        )
        residuals = np.linalg.norm(fixed - result.transform.apply(moving), axis=1)
        consistent = residuals <= inlier_mm
        if np.array_equal(consistent, inliers):
            break
        _require_majority(consistent, inlier_mm)
        inliers = consistent
    else:
        raise NoConsensusError(f"inliers did not converge in {MAX_REFITS} refits")
    leave_one_out = np.full(len(fixed), np.nan)
    leave_one_out[inliers] = result.leave_one_out_mm
    result = replace(
        result,
        residuals_mm=residuals,
        leave_one_out_mm=leave_one_out,
        outliers=tuple(np.flatnonzero(~inliers).tolist()),
        method="paired_points_robust",
    )
    targets = fixed[inliers] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return evaluate_acceptance(result, targets, limits or AcceptanceLimits())


def largest_consistent_group(
    fixed: FloatArray, moving: FloatArray, inlier_mm: float
) -> NDArray[np.bool_]:
    """Return the mask (n,) of pairs within ``inlier_mm`` by the best motion of three pairs."""
    triples = _triples(len(fixed))
    rotations, translations, valid = _motions_of_triples(fixed[triples], moving[triples])
    if not valid.any():
        raise NoConsensusError(
            f"all triples of the {len(fixed)} points are collinear; expected at least one triangle"
        )
    rotations, translations = rotations[valid], translations[valid]
    mapped = np.einsum("tij,nj->tni", rotations, moving) + translations[:, None]
    squared = np.sum((fixed - mapped) ** 2, axis=2)
    agree = squared <= inlier_mm**2
    score = np.minimum(squared, inlier_mm**2).sum(axis=1)
    best = int(np.argmin(score))
    _require_majority(agree[best], inlier_mm)
    # Another group of the same size is ambiguous if it excludes points of the best group and its
    # motion differs.
    excluded = (agree[best] & ~agree).sum(axis=1)
    separation = np.sqrt(np.mean(np.sum((mapped - mapped[best]) ** 2, axis=2), axis=1))
    rivals = (
        (agree.sum(axis=1) >= agree[best].sum()) & (excluded > 0) & (separation > 2.0 * inlier_mm)
    )
    if rivals.any():
        other = int(np.flatnonzero(rivals)[0])
        raise NoConsensusError(
            f"two groups of {int(agree[best].sum())} points agree on motions that differ by "
            f"{separation[other]:.3g} mm RMS: {np.flatnonzero(agree[best]).tolist()} and "
            f"{np.flatnonzero(agree[other]).tolist()}; expected one group"
        )
    return np.asarray(agree[best])


def _require_majority(agree: NDArray[np.bool_], inlier_mm: float) -> None:
    min_inliers = max(MIN_POINTS, len(agree) // 2 + 1)
    if agree.sum() < min_inliers:
        raise NoConsensusError(
            f"only {int(agree.sum())} of {len(agree)} points agree within {inlier_mm:g} mm; "
            f"expected at least {min_inliers}"
        )


def _triples(count: int) -> NDArray[np.intp]:
    if math.comb(count, 3) <= MAX_TRIPLES:
        return np.array(list(combinations(range(count), 3)), dtype=np.intp)
    draw = np.random.default_rng(0).random((MAX_TRIPLES, count))
    return np.argpartition(draw, 3, axis=1)[:, :3]


def _motions_of_triples(
    fixed: FloatArray, moving: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return rotations (t, 3, 3), translations (t, 3) and the mask (t,) of triangles.

    ``fixed`` and ``moving`` are triples (t, 3, 3); collinear ones are not triangles.
    """
    fixed_centre, moving_centre = fixed.mean(axis=1), moving.mean(axis=1)
    centred_fixed = fixed - fixed_centre[:, None]
    centred_moving = moving - moving_centre[:, None]
    valid = np.ones(len(fixed), dtype=bool)
    for centred in (centred_fixed, centred_moving):
        values = np.linalg.svd(centred, compute_uv=False)
        valid &= values[:, 1] > COLLINEAR_RATIO * values[:, 0]
    left, _, right = np.linalg.svd(np.swapaxes(centred_fixed, 1, 2) @ centred_moving)
    right[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    rotations = left @ right
    translations = fixed_centre - np.einsum("tij,tj->ti", rotations, moving_centre)
    return rotations, translations, valid
