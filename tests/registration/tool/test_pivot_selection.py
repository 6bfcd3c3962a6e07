"""Poses of a pivot are selected by their information about the tip."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.registration import (
    PoseNoise,
    TooFewError,
    calibrate_pivot,
    expected_tip_sigma_mm,
    select_pivot_poses,
    select_poses,
)

NOISE = PoseNoise.from_rms(rotation_deg=0.2, translation_mm=0.2)


def swung(seed, tip_mm, *, degrees, count=400, noise=NOISE):
    """A slow swing about the tip at 20 Hz: over a cone, with a rotation about the shaft."""
    rng = np.random.default_rng(seed)
    poses = []
    for phase in np.linspace(0.0, 6.0 * np.pi, count):
        tilt = 0.5 * np.radians(degrees) * np.array([np.cos(phase), np.sin(1.3 * phase), 0.2])
        turn = Rotation.from_rotvec(rng.normal(0.0, noise.rotation_rad, 3)) * Rotation.from_rotvec(
            tilt
        )
        origin = -turn.apply(tip_mm) + rng.normal(0.0, noise.translation_mm, 3)
        poses.append(Transform("reference", "needle", turn.as_matrix(), origin))
    return poses


def calibrated(poses: list[Transform]):
    return calibrate_pivot([poses[index] for index in select_pivot_poses(poses)])


def test_sensor_close_to_the_tip_gives_a_tip():
    """The distance that the sensor moves does not count: here never 3 mm between two samples."""
    tip = [0.5, 0.3, 2.0]
    poses = swung(1, tip, degrees=90.0)
    assert len(select_poses(poses)) < 10, "a fixed distance leaves too few poses"
    result = calibrated(poses)
    assert result.accepted, result.reason
    assert np.linalg.norm(result.tip_mm - tip) < 3.0 * result.tip_sigma_mm


def test_sigma_of_a_short_lever_holds(sample):
    """Errors over recordings against their sigma, also over a narrow cone."""
    tip, errors, sigmas = [0.0, 0.2, 3.0], [], []
    for seed in range(5 * sample):
        result = calibrated(swung(seed, tip, degrees=28.0))
        assert result.accepted, result.reason
        errors.append(np.linalg.norm(result.tip_mm - tip))
        sigmas.append(result.tip_sigma_mm)
    assert np.sqrt(np.mean(np.square(errors))) < 1.4 * np.mean(sigmas)
    assert max(errors) < 0.5


def test_narrow_cone_of_a_long_tool_is_still_refused():
    result = calibrated(swung(2, [0.0, 0.0, 150.0], degrees=20.0))
    assert not result.accepted and "swings over" in result.reason


def test_wide_swing_keeps_the_widest_spacing():
    poses = swung(3, [0.0, 0.0, 120.0], degrees=90.0, count=900)
    widest = select_poses(poses, min_distance_mm=0.0, min_angle_rad=np.radians(5.0))
    assert select_pivot_poses(poses) == widest
    assert expected_tip_sigma_mm([poses[index] for index in widest]) <= 0.25


def test_few_wide_poses_are_completed_by_closer_ones():
    poses = swung(4, [0.0, 0.0, 60.0], degrees=40.0, count=120)
    chosen = select_pivot_poses(poses)
    widest = select_poses(poses, min_distance_mm=0.0, min_angle_rad=np.radians(5.0))
    assert len(chosen) > len(widest)
    sigmas = [expected_tip_sigma_mm([poses[i] for i in each]) for each in (chosen, widest)]
    assert sigmas[0] < sigmas[1]


def test_tool_that_does_not_turn_is_named():
    still = PoseNoise(1e-5, 0.01)
    poses = swung(5, [0.0, 0.0, 60.0], degrees=0.2, noise=still)
    with pytest.raises(TooFewError, match=r"turn by at most 0\.\d+ degrees from the first"):
        select_pivot_poses(poses)
