"""Small motions, least squares, quantiles, and lists of poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2
from scipy.stats import f as fisher
from scipy.stats import t as student

from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    ConvergenceError,
    NoValidSamplesError,
    PoseNoise,
    ShapeError,
    TooFewError,
    select_poses,
    usable_poses,
)
from app.registration.consensus import chi_square_quantile, f_quantile, student_quantile
from app.registration.small_motion import (
    apply_motion,
    least_squares,
    move_origin,
    point_jacobian,
    skew,
)
from tests.registration.helpers import motion_between, random_transform

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=30)
@given(seed=SEEDS)
def test_skew_is_the_cross_product(seed):
    one, other = np.random.default_rng(seed).normal(size=(2, 5, 3))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", skew(one), other), np.cross(one, other), atol=1e-12
    )


@settings(max_examples=30)
@given(seed=SEEDS)
def test_motion_between_recovers_an_applied_motion(seed):
    rng = np.random.default_rng(seed)
    estimate = random_transform(rng)
    motion = np.concatenate([rng.normal(scale=0.3, size=3), rng.normal(scale=20.0, size=3)])
    truth = apply_motion(estimate, motion, np.zeros(3))
    np.testing.assert_allclose(motion_between(truth, estimate), motion, atol=1e-9)


@settings(max_examples=30)
@given(seed=SEEDS)
def test_point_jacobian_is_the_derivative_of_apply_motion(seed):
    rng = np.random.default_rng(seed)
    estimate, points = random_transform(rng), rng.uniform(-100, 100, (4, 3))
    motion = 1e-6 * rng.normal(size=6)
    before = estimate.apply(points)
    after = apply_motion(estimate, motion, np.zeros(3)).apply(points)
    np.testing.assert_allclose(after - before, point_jacobian(before) @ motion, atol=1e-8)


@settings(max_examples=30)
@given(seed=SEEDS)
def test_moved_covariance_gives_the_same_point_covariance(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * np.repeat([0.01, 1.0], 3)[:, None]
    covariance, centre = root @ root.T, rng.uniform(-200, 200, 3)
    point = rng.uniform(-200, 200, (1, 3))
    about_origin = point_jacobian(point)[0]
    about_centre = point_jacobian(point - centre)[0]
    found = about_centre @ move_origin(covariance, centre) @ about_centre.T
    expected = about_origin @ covariance @ about_origin.T
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def add(state: FloatArray, step: FloatArray) -> FloatArray:
    return state + step


def test_rosenbrock_converges():
    """Full Gauss-Newton steps overshoot on this function."""

    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residuals = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
        return residuals, -np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    answer = least_squares(np.array([-1.2, 1.0]), linearise, add, "it")
    np.testing.assert_allclose(answer, [1.0, 1.0], atol=1e-9)


def test_linear_problem_agrees_with_lstsq():
    rng = np.random.default_rng(1)
    matrix, right = rng.normal(size=(9, 4)), rng.normal(size=9)
    answer = least_squares(np.zeros(4), lambda x: (right - matrix @ x, matrix), add, "it")
    np.testing.assert_allclose(answer, np.linalg.lstsq(matrix, right, rcond=None)[0], atol=1e-10)


def test_converges_at_a_kink():
    """|x - 3| + 1, whose slope jumps at its minimum."""

    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.abs(x - 3.0) + 1.0, -np.diag(np.sign(x - 3.0))

    answer = least_squares(np.array([10.0]), linearise, add, "it")
    np.testing.assert_allclose(answer, [3.0], atol=1e-4)


def test_missing_convergence_is_an_error():
    def linearise(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residuals = 1e100 * np.exp(-x)  # decreases without a minimum
        return residuals, residuals[:, None]

    with pytest.raises(ConvergenceError, match="the slide did not converge in 200 steps"):
        least_squares(np.array([0.0]), linearise, add, "the slide")


@pytest.mark.parametrize("probability", [0.001, 0.05, 0.5, 0.975, 0.99999])
@pytest.mark.parametrize("freedom", [1, 3, 17, 4000])
def test_quantiles_agree_with_scipy_stats(probability, freedom):
    chi_square = chi_square_quantile(probability, freedom)
    assert chi_square == pytest.approx(chi2.ppf(probability, freedom), rel=1e-10)
    by_student = student.ppf(probability, freedom)
    assert student_quantile(probability, freedom) == pytest.approx(by_student, rel=1e-9, abs=1e-12)
    for denominator in (2, 12, 200):
        expected = fisher.ppf(probability, freedom, denominator)
        assert f_quantile(probability, freedom, denominator) == pytest.approx(expected, rel=1e-9)


def moving(steps_mm: list[float], steps_deg: list[float]) -> list[Transform]:
    return [
        Transform.from_rotation_vector(
            [0.0, 0.0, np.radians(turn)], [shift, 0.0, 0.0], target="reference", source="tool"
        )
        for shift, turn in zip(np.cumsum(steps_mm), np.cumsum(steps_deg), strict=True)
    ]


def test_pose_is_selected_if_it_moved_and_rotated_since_the_last_selected():
    poses = moving([0, 2, 2, 9, 0, 3], [0, 3, 3, 0, 9, 2])
    assert select_poses(poses) == (0, 2, 4)
    assert select_poses(poses, min_distance_mm=0.0, min_angle_rad=0.0) == (0, 1, 2, 3, 4, 5)
    with pytest.raises(TooFewError):
        select_poses([])


def test_only_ok_samples_are_used():
    rng = np.random.default_rng(1)
    pose = random_transform(rng, "tracker", "tool")
    lost = TrackedTransform.lost("tracker", "tool", Stamp(1), TrackingStatus.INVALID)
    missing = TrackedTransform.lost("tracker", "tool", Stamp(2), TrackingStatus.MISSING)
    good = TrackedTransform(pose, Stamp(3), TrackingStatus.OK)
    assert usable_poses([lost, good, missing]) == (pose,)
    with pytest.raises(
        NoValidSamplesError, match=r"0 of 3 samples are OK \(2 INVALID, 1 MISSING\)"
    ):
        usable_poses([lost, missing, lost])
    with pytest.raises(NoValidSamplesError, match="none given"):
        usable_poses([])


def test_noise_is_per_axis():
    noise = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
    assert np.linalg.norm(noise.sigmas[3:]) == pytest.approx(0.5)
    assert np.degrees(np.linalg.norm(noise.sigmas[:3])) == pytest.approx(0.3)
    with pytest.raises(ShapeError, match="translation_mm"):
        PoseNoise(0.1, 0.0)
