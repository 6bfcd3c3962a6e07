"""Paired points of which some are wrong: the largest group that agrees, the others named.

Consensus over triples (Fischler and Bolles 1981, scored as in MSAC by Torr and Zisserman 2000):
every triple up to a count, a fixed draw beyond it, so that the same points give the same answer.
"""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry import FloatArray
from app.registration.errors import NoConsensusError, ShapeError
from app.registration.inputs import COLLINEAR_RATIO, MIN_POINTS, as_pairs, as_points
from app.registration.points.paired import registration_of
from app.registration.points.rigid_fit import PairNoise
from app.registration.uncertainty.acceptance import AcceptanceLimits, judge
from app.registration.uncertainty.result import RegistrationResult

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
    """As `register_points`, with pairs that miss by more than ``inlier_mm`` dropped and named.

    ``inlier_mm`` is the largest residual of a good pair: three times the localisation error or so.
    More than half of the pairs, and at least three, have to agree on one motion, and no other
    group of that size on another one; `NoConsensusError` otherwise. In the result the residuals
    are of all pairs, the leave-one-out errors of the dropped ones are NaN.
    """
    if not (math.isfinite(inlier_mm) and inlier_mm > 0.0):
        raise ShapeError(f"inlier_mm is {inlier_mm}: above 0 wanted")
    fixed, moving = as_pairs(fixed_mm, moving_mm)
    noise = PairNoise.of(covariances_mm2, moving_covariances_mm2, len(fixed))
    good = largest_agreeing_group(fixed, moving, inlier_mm)
    for _ in range(MAX_REFITS):
        result = registration_of(
            fixed[good],
            moving[good],
            None if noise is None else noise.of_points(good),
            fixed_frame,
            moving_frame,
        )
        residuals = np.linalg.norm(fixed - result.transform.apply(moving), axis=1)
        again = residuals <= inlier_mm
        if np.array_equal(again, good):
            break
        _require_majority(again, inlier_mm)
        good = again
    else:
        raise NoConsensusError(f"which points agree did not settle in {MAX_REFITS} rounds")
    left_out = np.full(len(fixed), np.nan)
    left_out[good] = result.leave_one_out_mm
    named = replace(
        result,
        residuals_mm=residuals,
        leave_one_out_mm=left_out,
        outliers=tuple(np.flatnonzero(~good).tolist()),
        method="paired_points_robust",
    )
    targets = fixed[good] if targets_mm is None else as_points(targets_mm, "targets_mm")
    return judge(named, targets, limits or AcceptanceLimits())


def largest_agreeing_group(
    fixed: FloatArray, moving: FloatArray, inlier_mm: float
) -> NDArray[np.bool_]:
    """Which pairs, a mask (n,), the best motion of three pairs maps within ``inlier_mm``."""
    triples = _triples(len(fixed))
    rotations, translations, sound = _motions_of_triples(fixed[triples], moving[triples])
    if not sound.any():
        raise NoConsensusError(f"every three of the {len(fixed)} points are on a line")
    rotations, translations = rotations[sound], translations[sound]
    mapped = np.einsum("tij,nj->tni", rotations, moving) + translations[:, None]
    squared = np.sum((fixed - mapped) ** 2, axis=2)
    agree = squared <= inlier_mm**2
    score = np.minimum(squared, inlier_mm**2).sum(axis=1)
    best = int(np.argmin(score))
    _require_majority(agree[best], inlier_mm)
    # A rival is as large and tells another story: it loses points that the best group holds.
    lost = (agree[best] & ~agree).sum(axis=1)
    apart = np.sqrt(np.mean(np.sum((mapped - mapped[best]) ** 2, axis=2), axis=1))
    rivals = (agree.sum(axis=1) >= agree[best].sum()) & (lost > 0) & (apart > 2.0 * inlier_mm)
    if rivals.any():
        other = int(np.flatnonzero(rivals)[0])
        raise NoConsensusError(
            f"two groups of {int(agree[best].sum())} points agree on motions that differ by "
            f"{apart[other]:.3g} mm RMS: {np.flatnonzero(agree[best]).tolist()} and "
            f"{np.flatnonzero(agree[other]).tolist()}"
        )
    return np.asarray(agree[best])


def _require_majority(agree: NDArray[np.bool_], inlier_mm: float) -> None:
    least = max(MIN_POINTS, len(agree) // 2 + 1)
    if agree.sum() < least:
        raise NoConsensusError(
            f"only {int(agree.sum())} of {len(agree)} points agree within {inlier_mm:g} mm: "
            f"at least {least} wanted"
        )


def _triples(count: int) -> NDArray[np.intp]:
    if math.comb(count, 3) <= MAX_TRIPLES:
        return np.array(list(combinations(range(count), 3)), dtype=np.intp)
    draw = np.random.default_rng(0).random((MAX_TRIPLES, count))
    return np.argpartition(draw, 3, axis=1)[:, :3]


def _motions_of_triples(
    fixed: FloatArray, moving: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Rotations (t, 3, 3), translations (t, 3) and which triples (t, 3, 3) are no line."""
    fixed_centre, moving_centre = fixed.mean(axis=1), moving.mean(axis=1)
    centred_fixed = fixed - fixed_centre[:, None]
    centred_moving = moving - moving_centre[:, None]
    sound = np.ones(len(fixed), dtype=bool)
    for centred in (centred_fixed, centred_moving):
        values = np.linalg.svd(centred, compute_uv=False)
        sound &= values[:, 1] > COLLINEAR_RATIO * values[:, 0]
    left, _, right = np.linalg.svd(np.swapaxes(centred_fixed, 1, 2) @ centred_moving)
    right[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    rotations = left @ right
    translations = fixed_centre - np.einsum("tij,tj->ti", rotations, moving_centre)
    return rotations, translations, sound
