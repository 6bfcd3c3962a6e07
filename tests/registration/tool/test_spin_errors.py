"""Poses and tips from which no spin can be calibrated."""

import numpy as np
import pytest

from app.registration import (
    DegenerateMotionError,
    NotFiniteError,
    PoseNoise,
    ShapeError,
    TooFewError,
    calibrate_spin,
)
from tests.registration.helpers import pivot_scene

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


def test_degenerate_poses_raise_specific_errors() -> None:
    rng = np.random.default_rng(5)
    scene = pivot_scene(rng, 30, cone_deg=0.0, noise=None, spin_deg=60.0)
    with pytest.raises(TooFewError, match="9 poses for a spin"):
        calibrate_spin(scene.poses[:9], tip_mm=scene.tip_mm)
    with pytest.raises(DegenerateMotionError, match="one pose repeated"):
        calibrate_spin([scene.poses[0]] * 20, tip_mm=scene.tip_mm)
    with pytest.raises(DegenerateMotionError, match="expected at least 15"):
        still = pivot_scene(rng, 30, cone_deg=0.0, noise=EM_NOISE, spin_deg=4.0)
        calibrate_spin(still.poses, tip_mm=scene.tip_mm)
    with pytest.raises(DegenerateMotionError, match="across the line to the tip"):
        beside = np.cross(scene.tip_mm, [1.0, 2.0, 3.0])
        calibrate_spin(scene.poses, tip_mm=beside)
    with pytest.raises(ShapeError, match="max_sigma_rad"):
        calibrate_spin(scene.poses, tip_mm=scene.tip_mm, max_sigma_rad=-1.0)


@pytest.mark.parametrize(
    ("tip", "error"),
    [
        ([0.0, 0.0, 0.0], DegenerateMotionError),
        ([0.0, float("nan"), 1.0], NotFiniteError),
        ([1.0, 2.0], ShapeError),
        ([[1.0], [2.0, 3.0]], ShapeError),
    ],
)
def test_tip_that_does_not_determine_the_sign_is_rejected(
    tip: list[float], error: type[Exception]
) -> None:
    scene = pivot_scene(np.random.default_rng(6), 20, cone_deg=0.0, noise=None, spin_deg=60.0)
    with pytest.raises(error):
        calibrate_spin(scene.poses, tip_mm=tip)
