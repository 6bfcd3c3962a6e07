"""Paired-point registration: accuracy, covariance, acceptance, invalid input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from app.geometry import FrameError
from app.registration import (
    AcceptanceLimits,
    CoincidentPointsError,
    CollinearPointsError,
    CovarianceError,
    MirroredPointsError,
    NotFiniteError,
    ScaleMismatchError,
    ShapeError,
    TooFewError,
    UnequalCountsError,
    register_points,
)
from tests.registration.helpers import (
    draw,
    motion_between,
    random_covariances,
    random_layout,
    random_transform,
)

FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}
BOX = np.array([[0, 0, 0], [80, 0, 0], [0, 60, 0], [0, 0, 40], [70, 50, 30]], dtype=float)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 12), weighted=st.booleans())
def test_noise_free_points_give_the_true_transform(seed, count, weighted):
    rng = np.random.default_rng(seed)
    truth = random_transform(rng)
    moving = random_layout(rng, count)
    noise = random_covariances(rng, count) if weighted else None
    result = register_points(truth.apply(moving), moving, covariances_mm2=noise, **FRAMES)
    assert result.transform.angle_to(truth) < 1e-10
    error = result.transform.apply(moving) - truth.apply(moving)
    assert np.abs(error).max() < 1e-9
    assert (result.transform.target, result.transform.source) == ("fixed", "moving")


def test_agrees_with_scipy_on_noisy_points():
    rng = np.random.default_rng(1)
    truth = random_transform(rng)
    moving = random_layout(rng, 9)
    fixed = truth.apply(moving) + rng.normal(scale=0.7, size=(9, 3))
    result = register_points(fixed, moving, **FRAMES)
    peer, _ = Rotation.align_vectors(fixed - fixed.mean(axis=0), moving - moving.mean(axis=0))
    np.testing.assert_allclose(result.transform.rotation, peer.as_matrix(), atol=1e-12)
    residuals = np.linalg.norm(fixed - result.transform.apply(moving), axis=1)
    np.testing.assert_allclose(result.residuals_mm, residuals)
    assert result.fre_mm == pytest.approx(np.sqrt(np.mean(residuals**2)))


def test_weighted_result_maximises_the_likelihood():
    """Every small motion of the result increases the weighted misfit."""
    rng = np.random.default_rng(2)
    truth = random_transform(rng)
    moving = random_layout(rng, 7)
    noise = random_covariances(rng, 7, low_mm=0.05, high_mm=3.0)
    fixed = truth.apply(moving) + draw(rng, noise)
    answer = register_points(fixed, moving, covariances_mm2=noise, **FRAMES).transform

    def cost(rotation: np.ndarray, translation: np.ndarray) -> float:
        misfit = fixed - (moving @ rotation.T + translation)
        return float(np.einsum("ni,nij,nj->", misfit, np.linalg.inv(noise), misfit))

    best = cost(answer.rotation, answer.translation_mm)
    for _ in range(60):
        turn = Rotation.from_rotvec(rng.normal(scale=1e-4, size=3)).as_matrix()
        shift = rng.normal(scale=1e-2, size=3)
        assert cost(turn @ answer.rotation, answer.translation_mm + shift) > best


def test_covariances_of_the_moving_points_are_rotated():
    rng = np.random.default_rng(3)
    truth = random_transform(rng)
    moving = random_layout(rng, 6)
    in_moving = random_covariances(rng, 6)
    in_fixed = truth.rotation @ in_moving @ truth.rotation.T
    fixed = truth.apply(moving) + draw(rng, in_fixed * 1e-4)
    by_moving = register_points(fixed, moving, moving_covariances_mm2=in_moving, **FRAMES)
    by_fixed = register_points(fixed, moving, covariances_mm2=in_fixed, **FRAMES)
    assert by_moving.transform.distance_mm_to(by_fixed.transform) < 1e-3
    assert by_moving.covariance is not None and by_fixed.covariance is not None
    np.testing.assert_allclose(by_moving.covariance, by_fixed.covariance, rtol=0.02, atol=1e-4)


@pytest.mark.parametrize("known", [True, False])
def test_covariance_is_calibrated(known, sample):
    """The mean normalised squared error of the trials is within its 95 % band.

    With estimated noise the band is 99.9 % and drawn, as the distribution is not tabulated.
    """
    rng = np.random.default_rng(4 + known)
    trials, count = 50 * sample, 6
    errors = []
    for _ in range(trials):
        truth = random_transform(rng)
        moving = random_layout(rng, count)
        equal = np.tile(0.16 * np.eye(3), (count, 1, 1))
        noise = random_covariances(rng, count) if known else equal
        fixed = truth.apply(moving) + draw(rng, noise)
        result = register_points(fixed, moving, covariances_mm2=noise if known else None, **FRAMES)
        motion = motion_between(truth, result.transform)
        errors.append(motion @ np.linalg.solve(result.covariance, motion))
    if known:
        low, high = chi2.ppf([0.025, 0.975], 6 * trials) / trials
    else:
        of_f = f_distribution(6, 3 * count - 6)
        drawn = 6 * of_f.rvs((4000, trials), random_state=np.random.default_rng(0))
        low, high = np.quantile(drawn.mean(axis=1), [0.0005, 0.9995])
    assert low < np.mean(errors) < high


def test_leave_one_out_agrees_with_registrations_of_the_others():
    rng = np.random.default_rng(6)
    moving = random_layout(rng, 6)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.5, size=(6, 3))
    result = register_points(fixed, moving, **FRAMES)
    for point in range(6):
        others = np.arange(6) != point
        partial = register_points(fixed[others], moving[others], **FRAMES).transform
        expected = np.linalg.norm(fixed[point] - partial.apply(moving[point]))
        assert result.leave_one_out_mm[point] == pytest.approx(expected, abs=1e-12)


def test_leave_one_out_is_nan_if_the_others_are_collinear():
    moving = np.array([[0, 0, 0], [50, 0, 0], [100, 0, 0], [40, 60, 0]], dtype=float)
    result = register_points(moving + 5.0, moving, **FRAMES)
    assert np.isnan(result.leave_one_out_mm).tolist() == [False, False, False, True]


def test_three_points_have_three_degrees_of_freedom_and_no_leave_one_out_error():
    moving = BOX[:3]
    result = register_points(moving + np.diag([0.4, 0.4, 0.4]), moving, **FRAMES)
    assert np.isnan(result.leave_one_out_mm).all()
    assert result.degrees_of_freedom == 3
    assert "leave-one-out error is not available" in result.reason


def test_fre_does_not_decide_acceptance():
    rng = np.random.default_rng(7)
    moving = random_layout(rng, 6)
    fixed = random_transform(rng).apply(moving) + rng.normal(scale=0.05, size=(6, 3))
    far = fixed.mean(axis=0) + 20_000.0
    small_fre = register_points(fixed, moving, targets_mm=[far], **FRAMES)
    assert small_fre.fre_mm is not None and small_fre.fre_mm < 0.1
    assert not small_fre.accepted and "predicted TRE" in small_fre.reason

    many = random_layout(rng, 300)
    noisy = random_transform(rng).apply(many) + rng.normal(scale=1.0, size=(300, 3))
    options = {"targets_mm": [noisy.mean(axis=0)], "limits": AcceptanceLimits(1.0, 9.0)}
    large_fre = register_points(noisy, many, **options, **FRAMES)
    assert large_fre.fre_mm is not None and large_fre.fre_mm > 1.5
    assert large_fre.accepted, large_fre.reason


def test_large_leave_one_out_error_is_not_accepted_and_names_the_point():
    moving = BOX.copy()
    fixed = moving.copy()
    fixed[3] += [0.0, 0.0, 9.0]
    limits = AcceptanceLimits(tre_mm=1e3, leave_one_out_mm=5.0)
    result = register_points(fixed, moving, limits=limits, **FRAMES)
    assert not result.accepted and "leave-one-out error of point 3 is" in result.reason


def with_value(value: float) -> np.ndarray:
    points = BOX.copy()
    points[2, 1] = value
    return points


LINE = np.outer(np.linspace(0.0, 100.0, 6), [1.0, 2.0, -1.0])
ZIGZAG = np.array([[0, 0, 0], [1, 2, 0], [2, -2, 1], [3, 1, -1], [4, -1, 0], [5, 0, 0.0]])
NEAR_LINE = LINE + 0.5 * ZIGZAG


@pytest.mark.parametrize(
    ("fixed", "moving", "error", "message"),
    [
        (BOX[:2], BOX[:2], TooFewError, "2 point pairs; expected at least 3"),
        (BOX, BOX[:4], UnequalCountsError, "5 points and moving_mm 4"),
        (BOX, with_value(np.nan), NotFiniteError, "point 2 of moving_mm"),
        (with_value(np.inf), BOX, NotFiniteError, "point 2 of fixed_mm"),
        (np.ones((4, 3)), BOX[:4], CoincidentPointsError, "of fixed_mm coincide"),
        (BOX[:4], np.ones((4, 3)), CoincidentPointsError, "of moving_mm coincide"),
        (LINE, LINE, CollinearPointsError, "collinear"),
        (NEAR_LINE, NEAR_LINE, CollinearPointsError, "collinear"),
        (0.001 * NEAR_LINE, 0.001 * NEAR_LINE, CollinearPointsError, "collinear"),
        (1000 * NEAR_LINE, 1000 * NEAR_LINE, CollinearPointsError, "collinear"),
        (BOX, BOX * [1, 1, -1], MirroredPointsError, "mirror image"),
        (BOX, BOX / 1000.0, ScaleMismatchError, "are both in mm"),
        (BOX / 1000.0, BOX, ScaleMismatchError, "are both in mm"),
        (BOX[:, :2], BOX, ShapeError, r"shape \(5, 2\)"),
        ([], [], ShapeError, r"\(n, 3\)"),
        ([["a", "b", "c"]] * 3, BOX[:3], ShapeError, "not an array of numbers"),
    ],
)
def test_invalid_points_raise_specific_errors(fixed, moving, error, message):
    with pytest.raises(error, match=message) as raised:
        register_points(fixed, moving, **FRAMES)
    assert "\n" not in str(raised.value)


def test_collinearity_limit_is_a_ratio_of_one_twentieth():
    corners = np.array([[-50, -1, 0], [50, -1, 0], [50, 1, 0], [-50, 1, 0]], dtype=float)
    with pytest.raises(CollinearPointsError, match=r"2\.45 mm RMS across .* 50 mm along"):
        register_points(corners * [1, 2.45, 1], corners * [1, 2.45, 1], **FRAMES)
    register_points(corners * [1, 2.55, 1], corners * [1, 2.55, 1], **FRAMES)


def test_landmark_sets_of_any_size_are_accepted():
    for scale in (0.01, 1.0, 1000.0):
        register_points(scale * BOX, scale * BOX, **FRAMES)


def test_mirrored_points_are_detected_in_noise():
    rng = np.random.default_rng(8)
    mirrored = BOX * [1, 1, -1] + rng.normal(scale=0.5, size=BOX.shape)
    with pytest.raises(MirroredPointsError):
        register_points(BOX, mirrored, **FRAMES)


def test_flat_landmarks_in_noise_are_not_mirrored():
    rng = np.random.default_rng(9)
    flat = np.array([[0, 0, 0], [80, 0, 0], [80, 60, 0], [0, 60, 0], [30, 20, 0]], dtype=float)
    for _ in range(100):
        truth = random_transform(rng)
        fixed = truth.apply(flat) + rng.normal(scale=0.5, size=flat.shape)
        moving = flat + rng.normal(scale=0.5, size=flat.shape)
        assert register_points(fixed, moving, **FRAMES).transform.angle_to(truth) < 0.1


@pytest.mark.parametrize(
    ("covariances", "error"),
    [
        (-np.eye(3), CovarianceError),
        (np.zeros((3, 3)), CovarianceError),
        (1e-320 * np.eye(3), CovarianceError),  # its inverse overflows
        (np.diag([1e-30, 1.0, 1e30]), CovarianceError),
        ([[1, 0.9, 0], [0, 1, 0], [0, 0, 1]], CovarianceError),
        (np.full((3, 3), np.nan), NotFiniteError),
        (np.ones((4, 3, 3)), ShapeError),
    ],
)
def test_invalid_covariances_are_rejected(covariances, error):
    with pytest.raises(error):
        register_points(BOX, BOX, covariances_mm2=covariances, **FRAMES)


def test_frame_names_are_validated():
    with pytest.raises(FrameError):
        register_points(BOX, BOX, fixed_frame="a b", moving_frame="moving")
