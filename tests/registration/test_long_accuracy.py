"""Accuracy of registration and calibration over many trials; the suite has shorter forms."""

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from app.registration import (
    PoseNoise,
    calibrate_pivot,
    calibrate_spin,
    estimate_time_offset,
    predict_layout_tre,
    register_points,
    solve_robot_world,
)
from app.registration.paired_points import PairNoise, fit_rigid
from tests.oracles.registration_robot_world import opencv_base
from tests.oracles.registration_tool import least_squares_pivot
from tests.registration.helpers import (
    draw,
    motion_between,
    pivot_scene,
    random_covariances,
    random_layout,
    random_transform,
    robot_world_scene,
)
from tests.registration.time_signals import LAG_MS, streams

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1800)]

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
POSITION_NOISE = PoseNoise.from_rms(rotation_deg=1e-6, translation_mm=0.5)
FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_noise_free_data_give_the_true_transforms():
    rng = np.random.default_rng(1)
    for _ in range(1000):
        truth, moving = random_transform(rng), random_layout(rng, int(rng.integers(3, 12)))
        found = register_points(truth.apply(moving), moving, **FRAMES).transform
        assert np.abs(found.apply(moving) - truth.apply(moving)).max() <= 1e-9
        assert found.angle_to(truth) <= 1e-10
        scene = robot_world_scene(rng, 10, None)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        for one, other in (
            (result.registration.transform, scene.base),
            (result.tip_from_sensor, scene.mount),
        ):
            assert one.distance_mm_to(other) <= 1e-9
            assert one.angle_to(other) <= 1e-10
        pivot = pivot_scene(rng, 30, cone_deg=rng.uniform(31, 120), noise=None)
        tip = calibrate_pivot(pivot.poses, noise=EM_NOISE).tip_mm
        assert np.abs(tip - pivot.tip_mm).max() <= 1e-9


@pytest.mark.parametrize("noise", [EM_NOISE, None], ids=["known noise", "noise estimated"])
def test_base_of_15_noisy_poses_is_nearer_than_by_closed_forms(noise):
    rng = np.random.default_rng(2)
    errors = {"ours": [], "shah": [], "li": []}
    for _ in range(200):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        middle, poses = scene.base.inverse().apply(scene.centre_mm), (scene.robot, scene.sensor)
        for name, answer in (
            ("ours", solve_robot_world(*poses, noise=noise).registration.transform),
            ("shah", opencv_base(*poses, cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH)),
            ("li", opencv_base(*poses, cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI)),
        ):
            errors[name].append(np.linalg.norm(answer.apply(middle) - scene.centre_mm))
    assert rms(errors["ours"]) <= 0.30
    assert np.quantile(errors["ours"], 0.95) <= 0.45
    assert rms(errors["ours"]) < min(rms(errors["shah"]), rms(errors["li"]))


@pytest.mark.parametrize("kind", ["isotropic", "anisotropic, equal weights", "matched weights"])
def test_predicted_target_error_is_that_of_simulated_registrations(kind):
    rng = np.random.default_rng(3)
    for _ in range(100):
        landmarks = random_layout(rng, int(rng.integers(4, 9)))
        target = landmarks.mean(axis=0) + rng.normal(scale=80.0, size=3)
        noise = random_covariances(rng, len(landmarks), low_mm=0.05, high_mm=0.5)
        if kind == "isotropic":
            noise = np.tile(0.09 * np.eye(3), (len(landmarks), 1, 1))
        matched = kind == "matched weights"
        simulated = (matched_errors if matched else closed_form_errors)(
            rng, landmarks, target, noise
        )
        planned = predict_layout_tre(landmarks, [target], noise, matched_weights=matched)[0]
        assert 0.95 <= planned / simulated <= 1.05


def closed_form_errors(rng, landmarks, target, noise, draws=20_000):
    """RMS error in mm at the target (3,) of vectorised closed-form registrations."""
    root = np.linalg.cholesky(noise)
    fixed = landmarks + np.einsum("nij,dnj->dni", root, rng.normal(size=(draws, len(landmarks), 3)))
    centre, means = landmarks.mean(axis=0), fixed.mean(axis=1)
    product = np.swapaxes(fixed - means[:, None], 1, 2) @ (landmarks - centre)
    left, _, right = np.linalg.svd(product)
    right[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    errors = (left @ right) @ (target - centre) + means - target
    return rms(np.linalg.norm(errors, axis=1))


def matched_errors(rng, landmarks, target, noise, draws=2500):
    """RMS error in mm at the target (3,) of registrations that know the noise."""
    known = PairNoise.from_covariances(noise, None, len(landmarks))
    errors = []
    for _ in range(draws):
        found = fit_rigid(landmarks + draw(rng, noise), landmarks, known, "fixed", "moving")
        errors.append(np.linalg.norm(found.apply(target) - target))
    return rms(errors)


def points_error(rng):
    truth, moving = random_transform(rng), random_layout(rng, 6)
    noise = random_covariances(rng, 6)
    fixed = truth.apply(moving) + draw(rng, noise)
    result = register_points(fixed, moving, covariances_mm2=noise, **FRAMES)
    return motion_between(truth, result.transform), result.covariance


def base_error(rng):
    scene = robot_world_scene(rng, 15, EM_NOISE)
    result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
    motion = [
        motion_between(scene.base, result.registration.transform),
        motion_between(scene.mount, result.tip_from_sensor),
    ]
    return np.concatenate(motion), result.covariance


def pivot_error(rng):
    scene = pivot_scene(rng, 80, cone_deg=60.0, noise=EM_NOISE)
    result = calibrate_pivot(scene.poses, noise=EM_NOISE)
    return result.tip_mm - scene.tip_mm, result.covariance[:3, :3]


def spin_error(rng):
    scene = pivot_scene(rng, 200, cone_deg=0.0, noise=EM_NOISE, spin_deg=40.0)
    result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
    across = np.linalg.svd(result.shaft[None])[2][1:]
    error = across @ (scene.tip_mm / np.linalg.norm(scene.tip_mm) - result.shaft)
    return error, across @ result.covariance @ across.T


@pytest.mark.parametrize(
    ("stream", "trial"), list(enumerate((points_error, base_error, pivot_error, spin_error)))
)
def test_covariance_is_that_of_the_errors(stream, trial):
    rng, trials = np.random.default_rng([4, stream]), 500
    squared = []
    for _ in range(trials):
        error, covariance = trial(rng)
        squared.append(error @ np.linalg.solve(covariance, error))
    low, high = chi2.ppf([0.025, 0.975], len(error) * trials) / trials
    assert low <= np.mean(squared) <= high


@pytest.mark.parametrize(("poses", "share"), [(100, 0.95), (400, 1.0)])
def test_tip_of_a_wide_cone_with_wrong_poses_is_within_a_third_of_a_millimetre(poses, share):
    """A few seconds of recording are enough in 95 % of the trials, half a minute in all."""
    rng = np.random.default_rng(5)
    ours, peers = [], []
    for _ in range(200):
        scene = pivot_scene(rng, poses, cone_deg=60.0, noise=POSITION_NOISE, wrong_share=0.2)
        ours.append(np.linalg.norm(calibrate_pivot(scene.poses).tip_mm - scene.tip_mm))
        peers.append(np.linalg.norm(least_squares_pivot(scene.poses) - scene.tip_mm))
    assert np.quantile(ours, share) <= 0.3
    assert rms(ours) < rms(peers)


@pytest.mark.parametrize("noise", [POSITION_NOISE, EM_NOISE])
def test_narrow_cone_is_refused_or_its_covariance_holds(noise):
    rng, trials = np.random.default_rng(5), 200
    covered = accepted = 0
    for _ in range(trials):
        scene = pivot_scene(rng, 100, cone_deg=20.0, noise=noise, wrong_share=0.2)
        result = calibrate_pivot(scene.poses)
        error = result.tip_mm - scene.tip_mm
        squared = error @ np.linalg.solve(result.covariance[:3, :3], error)
        covered += bool(squared < chi2.ppf(0.95, 3))
        accepted += result.accepted
    assert accepted == 0 or covered / trials >= 0.93


def test_offset_of_two_clocks_is_within_a_millisecond_and_its_interval_covers_it():
    rng, trials = np.random.default_rng(6), 400
    errors, covered = [], 0
    for _ in range(trials):
        result = estimate_time_offset(*streams(rng))
        errors.append(result.offset_ns / 1e6 - LAG_MS)
        covered += result.interval_ns[0] <= LAG_MS * 1e6 <= result.interval_ns[1]
    assert np.quantile(np.abs(errors), 0.95) <= 1.0
    assert covered / trials >= 0.925
