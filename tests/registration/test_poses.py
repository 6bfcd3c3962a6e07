"""Selection and validation of lists of poses."""

import numpy as np
import pytest

from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    NoValidSamplesError,
    PoseNoise,
    ShapeError,
    TooFewError,
    select_poses,
    usable_poses,
)
from tests.registration.helpers import random_transform


def moving(steps_mm: list[float], steps_deg: list[float]) -> list[Transform]:
    return [
        Transform.from_rotation_vector(
            [0.0, 0.0, np.radians(turn)], [shift, 0.0, 0.0], target="reference", source="tool"
        )
        for shift, turn in zip(np.cumsum(steps_mm), np.cumsum(steps_deg), strict=True)
    ]


def test_pose_is_selected_if_it_moved_and_rotated_since_the_last_selected() -> None:
    poses = moving([0, 2, 2, 9, 0, 3], [0, 3, 3, 0, 9, 2])
    assert select_poses(poses) == (0, 2, 4)
    assert select_poses(poses, min_distance_mm=0.0, min_angle_rad=0.0) == (0, 1, 2, 3, 4, 5)
    with pytest.raises(TooFewError):
        select_poses([])


def test_only_ok_samples_are_used() -> None:
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


def test_noise_is_per_axis() -> None:
    noise = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
    assert np.linalg.norm(noise.sigmas[3:]) == pytest.approx(0.5)
    assert np.degrees(np.linalg.norm(noise.sigmas[:3])) == pytest.approx(0.3)
    with pytest.raises(ShapeError, match="translation_mm"):
        PoseNoise(0.1, 0.0)
