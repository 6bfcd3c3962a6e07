import numpy as np
import pytest

from app.registration import (
    NoConsensusError,
    ShapeError,
    register_points,
    register_points_robust,
)
from app.registration.errors import CollinearPointsError
from app.registration.points import robust
from tests.registration.helpers import random_layout, random_transform

FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


@pytest.mark.parametrize("count", [8, 40])
def test_wrong_pairs_are_named_and_do_no_harm(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(30):
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


def test_two_swapped_labels_are_named() -> None:
    rng = np.random.default_rng(3)
    moving = random_layout(rng, 7)
    fixed = random_transform(rng).apply(moving)
    fixed[[2, 5]] = fixed[[5, 2]]
    result = register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)
    assert result.outliers == (2, 5)


def test_clean_pairs_lose_nobody() -> None:
    rng = np.random.default_rng(4)
    moving = random_layout(rng, 6)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.1, size=(6, 3))
    result = register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)
    assert result.outliers == ()
    plain = register_points(fixed, moving, **FRAMES).transform
    np.testing.assert_array_equal(result.transform.matrix, plain.matrix)


def test_two_stories_of_one_size_are_not_decided_by_chance() -> None:
    """Landmarks 0 to 2 are shared; 3 and 4 went one way, 5 and 6 another."""
    base = np.array([[0, 0, 0], [100, 0, 0], [50, 1, 0]], dtype=float)
    extra = np.array([[0, 80, 0], [60, 90, 10], [0, -80, 0], [60, -90, 10]], dtype=float)
    moving = np.vstack([base, extra])
    fixed = moving.copy()
    fixed[5:, 1:] *= -1.0  # a half turn about the line of the first three
    with pytest.raises(NoConsensusError, match="two groups of 5"):
        register_points_robust(fixed, moving, inlier_mm=2.5, **FRAMES)


def test_no_agreement_is_an_error() -> None:
    rng = np.random.default_rng(5)
    with pytest.raises(NoConsensusError, match="only"):
        register_points_robust(
            rng.uniform(0, 100, (8, 3)), rng.uniform(0, 100, (8, 3)), inlier_mm=1.0, **FRAMES
        )


def test_less_than_half_is_no_majority() -> None:
    """Four of nine agree to rounding, and the others with nobody."""
    rng = np.random.default_rng(6)
    moving = random_layout(rng, 9)
    fixed = random_transform(rng).apply(moving)
    fixed[4:] += rng.uniform(20.0, 90.0, (5, 3)) * rng.choice([-1.0, 1.0], (5, 3))
    with pytest.raises(NoConsensusError, match="only 4 of 9 points agree within 1 mm: at least 5"):
        register_points_robust(fixed, moving, inlier_mm=1.0, **FRAMES)


def test_a_majority_that_melts_away_when_it_is_fitted_well_is_none() -> None:
    """Three pairs lay four on each other; the weights of these lay three."""
    rng = np.random.default_rng(29)
    moving = random_layout(rng, 7)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=1.0, size=(7, 3))
    noise = np.eye(3) * (10.0 ** rng.uniform(-2.0, 1.0, 7) ** 2)[:, None, None]
    assert robust.largest_agreeing_group(fixed, moving, 1.5).sum() >= 4
    with pytest.raises(NoConsensusError, match=r"only 3 of 7 points agree within 1\.5 mm"):
        register_points_robust(fixed, moving, inlier_mm=1.5, covariances_mm2=noise, **FRAMES)


def test_a_line_is_no_consensus() -> None:
    line = np.outer(np.arange(6.0), [10.0, 0, 0])
    with pytest.raises((NoConsensusError, CollinearPointsError), match=r"line|collinear"):
        register_points_robust(line, line, inlier_mm=1.0, **FRAMES)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_the_bound_of_a_good_pair_is_checked(bad: float) -> None:
    with pytest.raises(ShapeError, match="inlier_mm"):
        register_points_robust(np.eye(3), np.eye(3), inlier_mm=bad, **FRAMES)


def test_a_group_that_does_not_settle_is_no_consensus(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among these the first fit drops a pair, and nobody has looked at the fit without it."""
    rng = np.random.default_rng(9)
    moving = random_layout(rng, 8)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.7, size=(8, 3))
    weights = np.eye(3) * (10.0 ** rng.uniform(-2.0, 1.0, 8) ** 2)[:, None, None]
    settled = register_points_robust(
        fixed, moving, inlier_mm=1.5, covariances_mm2=weights, **FRAMES
    )
    assert settled.outliers
    monkeypatch.setattr(robust, "MAX_REFITS", 1)
    with pytest.raises(NoConsensusError, match="did not settle in 1 rounds"):
        register_points_robust(fixed, moving, inlier_mm=1.5, covariances_mm2=weights, **FRAMES)
