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
from app.registration.motion import moved
from tests.registration.helpers import disturbed, random_transform, robot_world_scene

BOUND = DriftBound(translation_mm=2.0, rotation_rad=np.radians(1.5))


def shifted(millimetres: float, degrees: float) -> tuple[Transform, Transform]:
    rng = np.random.default_rng(1)
    predicted = random_transform(rng, "reference", "tip")
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    motion = np.concatenate([np.radians(degrees) * direction, millimetres * direction])
    return predicted, moved(predicted, motion, predicted.translation_mm)


@pytest.mark.parametrize(
    ("millimetres", "degrees", "accepted"),
    [(0.0, 0.0, True), (1.9, 1.4, True), (2.1, 0.0, False), (0.0, 1.6, False), (50.0, 90.0, False)],
)
def test_either_bound_is_enough_to_refuse(
    millimetres: float, degrees: float, accepted: bool
) -> None:
    drift = check_drift(*shifted(millimetres, degrees), BOUND)
    assert drift.accepted is accepted
    assert drift.translation_mm == pytest.approx(millimetres, abs=1e-9)
    assert np.degrees(drift.rotation_rad) == pytest.approx(degrees, abs=1e-6)
    assert "tip is" in drift.reason and "2 mm and 1.5 degrees allowed" in drift.reason


def test_a_bound_from_the_noise_is_rarely_passed_without_drift() -> None:
    """And always soon after the base was pushed by a centimetre."""
    rng = np.random.default_rng(2)
    noise = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
    passed, pushed = 0, 0
    for _ in range(15):
        scene = robot_world_scene(rng, 15, noise)
        result = solve_robot_world(scene.robot, scene.sensor, noise=noise)
        for pose in scene.robot[:5]:
            truth = scene.base @ pose @ scene.mount
            predicted = result.reference_from_base @ pose @ result.tip_from_sensor
            measured = disturbed(rng, truth, noise)
            bound = DriftBound.from_noise(
                result.registration, truth.translation_mm, noise, sigmas=3.0
            )
            passed += not check_drift(predicted, measured, bound).accepted
            push = np.array([0.0, 0.0, 0.0, 10.0, 0.0, 0.0])
            moved_away = moved(truth, push, truth.translation_mm)
            pushed += not check_drift(predicted, moved_away, bound).accepted
    assert passed <= 2 and pushed == 75


def test_one_sigma_is_the_rms_of_both_errors_together() -> None:
    """The registration's as a motion about the reference's origin, and the tracker's."""
    rng = np.random.default_rng(3)
    noise = PoseNoise(rotation_rad=0.004, translation_mm=0.4)
    mixed = rng.normal(size=(6, 6)) * np.repeat([0.002, 0.2], 3)[:, None]
    found = replace(
        given_registration(Transform.identity("reference", "robot_base")),
        covariance=mixed @ mixed.T,
    )
    truth = random_transform(rng, "reference", "tip", reach_mm=100.0)
    bound = DriftBound.from_noise(found, truth.translation_mm, noise, sigmas=1.0)
    drifts = [
        check_drift(
            moved(truth, mixed @ rng.normal(size=6), np.zeros(3)),
            disturbed(rng, truth, noise),
            bound,
        )
        for _ in range(3000)
    ]
    shifts = np.array([drift.translation_mm for drift in drifts])
    turns = np.array([drift.rotation_rad for drift in drifts])
    assert bound.translation_mm == pytest.approx(np.sqrt(np.mean(shifts**2)), rel=0.05)
    assert bound.rotation_rad == pytest.approx(np.sqrt(np.mean(turns**2)), rel=0.05)


def test_a_given_registration_has_no_bound_of_its_own() -> None:
    given = given_registration(shifted(0.0, 0.0)[0])
    with pytest.raises(CovarianceError):
        DriftBound.from_noise(given, [0.0, 0, 0], PoseNoise(0.01, 0.3), sigmas=3.0)


def test_frames_and_bounds_are_checked() -> None:
    predicted, measured = shifted(1.0, 1.0)
    with pytest.raises(FrameError):
        check_drift(predicted, measured.renamed(source="needle"), BOUND)
    for bad in (0.0, float("nan"), float("inf")):
        with pytest.raises(ShapeError, match="rotation_rad"):
            DriftBound(1.0, bad)
