"""Drift between predicted and measured tool pose, and its bound."""

from dataclasses import replace

import numpy as np
import pytest

from app.geometry import FrameError, Transform
from app.registration import (
    CovarianceError,
    DriftBound,
    PoseNoise,
    ShapeError,
    check_drift,
    given_registration,
    solve_robot_world,
)
from app.registration.small_motion import apply_motion
from tests.registration.helpers import disturbed, random_transform, robot_world_scene

BOUND = DriftBound(translation_mm=2.0, rotation_rad=np.radians(1.5))


def shifted(millimetres: float, degrees: float) -> tuple[Transform, Transform]:
    rng = np.random.default_rng(1)
    predicted = random_transform(rng, "reference", "tip")
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    motion = np.concatenate([np.radians(degrees) * direction, millimetres * direction])
    return predicted, apply_motion(predicted, motion, predicted.translation_mm)


@pytest.mark.parametrize(
    ("millimetres", "degrees", "accepted"),
    [(0.0, 0.0, True), (1.9, 1.4, True), (2.1, 0.0, False), (0.0, 1.6, False), (50.0, 90.0, False)],
)
def test_drift_beyond_either_bound_is_not_accepted(millimetres, degrees, accepted):
    drift = check_drift(*shifted(millimetres, degrees), BOUND)
    assert drift.accepted is accepted
    assert drift.translation_mm == pytest.approx(millimetres, abs=1e-9)
    assert np.degrees(drift.rotation_rad) == pytest.approx(degrees, abs=1e-6)
    assert "tip is" in drift.reason and "expected at most 2 mm and 1.5 degrees" in drift.reason


def test_bound_from_noise_is_rarely_exceeded_without_drift(sample):
    """A displacement of the base by 10 mm always exceeds it."""
    rng = np.random.default_rng(2)
    noise = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
    false_alarms, detected, trials = 0, 0, 5 * sample
    for _ in range(trials):
        scene = robot_world_scene(rng, 15, noise)
        result = solve_robot_world(scene.robot, scene.sensor, noise=noise)
        for pose in scene.robot[:5]:
            truth = scene.base @ pose @ scene.mount
            predicted = result.registration.transform @ pose @ result.tip_from_sensor
            measured = disturbed(rng, truth, noise)
            place = truth.translation_mm
            bound = DriftBound.from_noise(result.registration, place, noise, sigmas=3.0)
            false_alarms += not check_drift(predicted, measured, bound).accepted
            push = np.array([0.0, 0.0, 0.0, 10.0, 0.0, 0.0])
            displaced = apply_motion(truth, push, place)
            detected += not check_drift(predicted, displaced, bound).accepted
    assert false_alarms <= sample and detected == 5 * trials


def test_one_sigma_bound_is_the_rms_of_registration_and_tracker_error():
    """The registration error is drawn as a motion about the origin of the reference."""
    rng = np.random.default_rng(3)
    noise = PoseNoise(rotation_rad=0.004, translation_mm=0.4)
    mixed = rng.normal(size=(6, 6)) * np.repeat([0.002, 0.2], 3)[:, None]
    given = given_registration(Transform.identity("reference", "robot_base"))
    found = replace(given, covariance=mixed @ mixed.T)
    truth = random_transform(rng, "reference", "tip", reach_mm=100.0)
    bound = DriftBound.from_noise(found, truth.translation_mm, noise, sigmas=1.0)
    drifts = []
    for _ in range(3000):
        registered = apply_motion(truth, mixed @ rng.normal(size=6), np.zeros(3))
        drifts.append(check_drift(registered, disturbed(rng, truth, noise), bound))
    shifts = np.array([drift.translation_mm for drift in drifts])
    turns = np.array([drift.rotation_rad for drift in drifts])
    assert bound.translation_mm == pytest.approx(np.sqrt(np.mean(shifts**2)), rel=0.05)
    assert bound.rotation_rad == pytest.approx(np.sqrt(np.mean(turns**2)), rel=0.05)


def test_given_registration_has_no_bound_from_noise():
    given = given_registration(shifted(0.0, 0.0)[0])
    with pytest.raises(CovarianceError):
        DriftBound.from_noise(given, [0.0, 0, 0], PoseNoise(0.01, 0.3), sigmas=3.0)


def test_frames_and_bounds_are_validated():
    predicted, measured = shifted(1.0, 1.0)
    with pytest.raises(FrameError):
        check_drift(predicted, measured.renamed(source="needle"), BOUND)
    for bad in (0.0, float("nan"), float("inf")):
        with pytest.raises(ShapeError, match="rotation_rad"):
            DriftBound(1.0, bad)
