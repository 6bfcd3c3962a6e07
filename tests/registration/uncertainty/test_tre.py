"""Predicted target registration error against formula and Monte Carlo."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.registration import (
    CollinearPointsError,
    CovarianceError,
    NotFiniteError,
    TooFewError,
    given_registration,
    largest_tre,
    predict_layout_tre,
    predict_tre,
    register_points,
    tre_covariances,
    tre_upper_bound,
)
from app.registration.paired_points import PairNoise, fit_rigid
from tests.oracles.registration_tre import fitzpatrick_tre
from tests.registration.helpers import draw, random_covariances, random_layout, random_transform

pytestmark = pytest.mark.slow

FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


def test_isotropic_noise_agrees_with_fitzpatricks_formula():
    rng = np.random.default_rng(1)
    for _ in range(20):
        landmarks = random_layout(rng, int(rng.integers(3, 10)))
        targets = landmarks.mean(axis=0) + rng.normal(scale=80.0, size=(5, 3))
        fle = rng.uniform(0.1, 2.0)
        noise = fle**2 / 3.0 * np.eye(3)
        expected = fitzpatrick_tre(landmarks, targets, fle)
        moving = random_transform(rng).inverse().apply(landmarks)
        result = register_points(landmarks, moving, covariances_mm2=noise, **FRAMES)
        np.testing.assert_allclose(predict_tre(result, targets), expected, rtol=1e-9)
        for matched in (True, False):
            planned = predict_layout_tre(landmarks, targets, noise, matched_weights=matched)
            np.testing.assert_allclose(planned, expected, rtol=1e-9)


def test_sigma_is_the_square_root_of_the_trace_of_the_covariance():
    rng = np.random.default_rng(4)
    for _ in range(20):
        landmarks = random_layout(rng, 6)
        moving = random_transform(rng).inverse().apply(landmarks)
        noise = random_covariances(rng, 6)
        result = register_points(landmarks, moving, covariances_mm2=noise, **FRAMES)
        targets = rng.normal(scale=200.0, size=(7, 3))
        traces = np.trace(tre_covariances(result, targets), axis1=1, axis2=2)
        np.testing.assert_allclose(predict_tre(result, targets), np.sqrt(traces), rtol=1e-9)
        with pytest.raises(NotFiniteError, match="nan"):
            predict_tre(result, np.array([[0.0, np.nan, 0.0]]))


def test_largest_error_is_that_at_the_tip_or_at_a_point_in_another_frame():
    rng = np.random.default_rng(5)
    at_tip = []
    for _ in range(40):
        factor = rng.normal(size=(6, 6))
        result = given_registration(random_transform(rng), factor @ factor.T)
        tip, other_tip = random_transform(rng), random_transform(rng)
        points = rng.normal(scale=50.0, size=(3, 3))
        placed = tip.apply(other_tip.inverse().apply(points))
        sigmas = predict_tre(result, [tip.translation_mm, *placed])
        assert largest_tre(result, tip, other_tip, points) == pytest.approx(sigmas.max(), rel=1e-9)
        at_tip.append(sigmas.argmax() == 0)
        points[1, 2] = np.nan
        assert np.isnan(largest_tre(result, tip, other_tip, points))
    assert 0 < sum(at_tip) < 40


@pytest.mark.parametrize("matched", [True, False])
def test_anisotropic_noise_agrees_with_monte_carlo(matched, sample):
    draws = 250 * sample
    rng = np.random.default_rng(2)
    for _ in range(2):
        landmarks = random_layout(rng, 6)
        noise = random_covariances(rng, 6)
        target = landmarks.mean(axis=0) + rng.normal(scale=80.0, size=(1, 3))
        planned = predict_layout_tre(landmarks, target, noise, matched_weights=matched)
        squared = []
        known = PairNoise.from_covariances(noise, None, 6) if matched else None
        for _ in range(draws):
            answer = fit_rigid(landmarks + draw(rng, noise), landmarks, known, "fixed", "moving")
            squared.append(np.sum((answer.apply(target) - target) ** 2))
        ratio = planned[0] / np.sqrt(np.mean(squared))
        assert ratio == pytest.approx(1.0, abs=2.3 / np.sqrt(draws))


def test_matched_weights_are_never_worse():
    rng = np.random.default_rng(3)
    for _ in range(15):
        landmarks = random_layout(rng, 7)
        noise = random_covariances(rng, 7)
        targets = landmarks.mean(axis=0) + rng.normal(scale=60.0, size=(4, 3))
        matched = predict_layout_tre(landmarks, targets, noise, matched_weights=True)
        equal = predict_layout_tre(landmarks, targets, noise, matched_weights=False)
        assert np.all(matched <= equal * (1.0 + 1e-9))


def test_upper_bound_has_its_stated_confidence(sample):
    """Three points, 3 degrees of freedom: the bound is above the true sigma in 95 %."""
    rng = np.random.default_rng(4)
    landmarks = np.array([[0, 0, 0], [90, 0, 0], [0, 70, 0]], dtype=float)
    target = np.array([[30.0, 20.0, -60.0]])
    truth = predict_layout_tre(landmarks, target, 0.09 * np.eye(3), matched_weights=True)[0]
    covered, below, trials = 0, 0, 250 * sample
    for _ in range(trials):
        fixed = landmarks + rng.normal(scale=0.3, size=(3, 3))
        result = register_points(fixed, landmarks, **FRAMES)
        covered += bool(tre_upper_bound(result, target)[0] > truth)
        below += bool(predict_tre(result, target)[0] < truth)
    assert covered / trials == pytest.approx(0.95, abs=3.0 * np.sqrt(0.95 * 0.05 / trials))
    assert below > trials / 2, "the plain estimate is too small in most cases"


def test_prediction_does_not_depend_on_the_origin():
    rng = np.random.default_rng(5)
    moving = random_layout(rng, 6)
    noise = random_covariances(rng, 6)
    fixed = moving + draw(rng, noise)
    offset = np.array([5000.0, -3000.0, 800.0])
    target = moving.mean(axis=0)[None] + 40.0
    near = register_points(fixed, moving, covariances_mm2=noise, **FRAMES)
    far = register_points(fixed + offset, moving, covariances_mm2=noise, **FRAMES)
    assert predict_tre(near, target) == pytest.approx(predict_tre(far, target + offset), rel=1e-6)


def test_given_registration_has_no_predicted_error():
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    given = given_registration(Transform("reference", "robot_base", turn, np.array([1.0, 2, 3])))
    assert given.accepted and given.covariance is None and given.fre_mm is None
    assert "given" in given.reason
    with pytest.raises(CovarianceError, match="not known"):
        predict_tre(given, [[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("landmarks", "error"),
    [
        ([[0.0, 0.0, 0.0]], TooFewError),
        ([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]], TooFewError),
        ([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [90.0, 0.1, 0.0]], CollinearPointsError),
    ],
)
def test_degenerate_layout_is_rejected(landmarks, error):
    for matched in (True, False):
        with pytest.raises(error):
            predict_layout_tre(landmarks, [[0, 0, 9]], np.eye(3), matched_weights=matched)
