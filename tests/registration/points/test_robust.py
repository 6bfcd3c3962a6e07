"""Rejection of wrong pairs in paired-point registration."""

import numpy as np
import pytest

from app.registration import (
    NoConsensusError,
    ShapeError,
    register_points,
    register_points_robust,
    robust_pairs,
)
from app.registration.input_checks import CollinearPointsError
from tests.registration.helpers import random_layout, random_transform

FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


@pytest.mark.parametrize("count", [8, 40])
def test_wrong_pairs_are_rejected_without_effect(count):
    rng = np.random.default_rng(count)
    for _ in range(8):
        truth = random_transform(rng)
        moving = random_layout(rng, count)
        fixed = truth.apply(moving) + rng.normal(scale=0.2, size=(count, 3))
        wrong = np.sort(rng.choice(count, int(0.3 * count), replace=False))
        fixed[wrong] += rng.choice([-1, 1], (len(wrong), 3)) * rng.uniform(8, 60, (len(wrong), 3))
        result = register_points_robust(fixed, moving, inlier_mm=2.0, **FRAMES)
        assert result.outliers == tuple(wrong)
        good = np.setdiff1d(np.arange(count), wrong)
        alone = register_points(fixed[good], moving[good], **FRAMES)
        np.testing.assert_allclose(result.transform.matrix, alone.transform.matrix, atol=1e-12)
        assert result.fre_mm == alone.fre_mm and result.used == tuple(good)
        assert np.all(result.residuals_mm[wrong] > 2.0)
        assert np.isnan(result.leave_one_out_mm[wrong]).all()


def test_swapped_pairs_are_rejected():
    rng = np.random.default_rng(3)
    moving = random_layout(rng, 7)
    fixed = random_transform(rng).apply(moving)
    fixed[[2, 5]] = fixed[[5, 2]]
    result = register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)
    assert result.outliers == (2, 5)


def test_clean_pairs_are_all_used():
    rng = np.random.default_rng(4)
    moving = random_layout(rng, 6)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.1, size=(6, 3))
    result = register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)
    assert result.outliers == ()
    plain = register_points(fixed, moving, **FRAMES).transform
    np.testing.assert_array_equal(result.transform.matrix, plain.matrix)


def test_two_consistent_groups_of_equal_size_are_an_error():
    """Pairs 0 to 2 are in both groups; 3 and 4 fit one motion, 5 and 6 another."""
    base = np.array([[0, 0, 0], [100, 0, 0], [50, 1, 0]], dtype=float)
    extra = np.array([[0, 80, 0], [60, 90, 10], [0, -80, 0], [60, -90, 10]], dtype=float)
    moving = np.vstack([base, extra])
    fixed = moving.copy()
    fixed[5:, 1:] *= -1.0  # half a turn about the line of the first three
    with pytest.raises(NoConsensusError, match="two groups of 5"):
        register_points_robust(fixed, moving, inlier_mm=2.5, **FRAMES)


def test_random_pairs_are_an_error():
    rng = np.random.default_rng(5)
    fixed, moving = rng.uniform(0, 100, (2, 8, 3))
    with pytest.raises(NoConsensusError, match="only"):
        register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)


def test_consistent_minority_is_an_error():
    """Four of nine pairs agree exactly, the others with none."""
    rng = np.random.default_rng(6)
    moving = random_layout(rng, 9)
    fixed = random_transform(rng).apply(moving)
    fixed[4:] += rng.uniform(20.0, 90.0, (5, 3)) * rng.choice([-1.0, 1.0], (5, 3))
    message = "only 4 of 9 points agree within 1 mm; expected at least 5"
    with pytest.raises(NoConsensusError, match=message):
        register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)


def test_majority_that_is_lost_by_the_refit_is_an_error():
    """Four pairs agree by a fit of three, but only three by their weighted fit."""
    rng = np.random.default_rng(29)
    moving = random_layout(rng, 7)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=1.0, size=(7, 3))
    noise = np.eye(3) * (10.0 ** rng.uniform(-2.0, 1.0, 7) ** 2)[:, None, None]
    assert robust_pairs.largest_consistent_group(fixed, moving, 1.5).sum() >= 4
    with pytest.raises(NoConsensusError, match=r"only 3 of 7 points agree within 1\.5 mm"):
        register_points_robust(fixed, moving, inlier_mm=1.5, covariances_mm2=noise, **FRAMES)


def test_collinear_points_are_an_error():
    line = np.outer(np.arange(6.0), [10.0, 0, 0])
    with pytest.raises((NoConsensusError, CollinearPointsError), match="collinear"):
        register_points_robust(line, line, inlier_mm=1.0, **FRAMES)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_inlier_bound_is_validated(bad):
    with pytest.raises(ShapeError, match="inlier_mm"):
        register_points_robust(np.eye(3), np.eye(3), inlier_mm=bad, **FRAMES)


def test_refits_without_convergence_are_an_error(monkeypatch):
    """The first fit rejects a pair, and the limit allows no refit without it."""
    rng = np.random.default_rng(9)
    moving = random_layout(rng, 8)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.7, size=(8, 3))
    weights = np.eye(3) * (10.0 ** rng.uniform(-2.0, 1.0, 8) ** 2)[:, None, None]
    options = {"inlier_mm": 1.5, "covariances_mm2": weights, **FRAMES}
    assert register_points_robust(fixed, moving, **options).outliers
    monkeypatch.setattr(robust_pairs, "MAX_REFITS", 1)
    with pytest.raises(NoConsensusError, match="did not converge in 1 refits"):
        register_points_robust(fixed, moving, **options)
