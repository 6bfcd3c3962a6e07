"""Spin calibration: accuracy, outliers, covariance, degenerate poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from app.geometry import FloatArray
from app.registration import (
    DegenerateMotionError,
    NotFiniteError,
    PoseNoise,
    ShapeError,
    TooFewError,
    calibrate_pivot,
    calibrate_spin,
)
from tests.oracles.registration_tool import eigenvector_spin
from tests.registration.helpers import pivot_scene

pytestmark = pytest.mark.slow

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


def angle_deg(one: FloatArray, other: FloatArray) -> float:
    """Angle in degrees, 0 to 90, between two axes."""
    unit = one / np.linalg.norm(one), other / np.linalg.norm(other)
    return float(np.degrees(np.arcsin(min(1.0, np.linalg.norm(np.cross(*unit))))))


@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1), spin=st.floats(15.0, 180.0))
def test_noise_free_poses_give_the_shaft_with_its_sign(seed, spin):
    scene = pivot_scene(np.random.default_rng(seed), 25, cone_deg=0.0, noise=None, spin_deg=spin)
    result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
    assert np.abs(result.shaft - scene.tip_mm / np.linalg.norm(scene.tip_mm)).max() < 1e-10
    backwards = calibrate_spin(scene.poses, tip_mm=-scene.tip_mm)
    np.testing.assert_array_equal(backwards.shaft, -result.shaft)


def test_wrong_poses_in_noise_are_rejected(sample):
    rng = np.random.default_rng(1)
    ours, peers = [], []
    for _ in range(4 * sample):
        scene = pivot_scene(rng, 60, cone_deg=0.0, noise=EM_NOISE, spin_deg=60.0, wrong_share=0.2)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        assert result.accepted, result.reason
        ours.append(angle_deg(result.shaft, scene.tip_mm))
        peers.append(angle_deg(eigenvector_spin(scene.poses), scene.tip_mm))
    assert max(ours) < 0.3 < np.mean(peers)


def test_covariance_is_calibrated(sample):
    rng = np.random.default_rng(2)
    trials, errors = 8 * sample, []
    for _ in range(trials):
        scene = pivot_scene(rng, 60, cone_deg=0.0, noise=EM_NOISE, spin_deg=40.0)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        across = np.linalg.svd(result.shaft[None])[2][1:]
        error = across @ (scene.tip_mm / np.linalg.norm(scene.tip_mm) - result.shaft)
        errors.append(error @ np.linalg.solve(across @ result.covariance @ across.T, error))
    low, high = chi2.ppf([0.001, 0.999], 2 * trials) / trials
    assert low < np.mean(errors) < high


def test_pivot_motion_is_never_accepted_as_a_spin(sample):
    rng = np.random.default_rng(3)
    for _ in range(3 * sample):
        scene = pivot_scene(rng, 60, cone_deg=50.0, noise=EM_NOISE)
        try:
            result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        except DegenerateMotionError as error:
            assert "expected a rotation of the tool about its shaft" in str(error)
        else:
            assert not result.accepted and "expected at most 0.5 degrees" in result.reason


def test_pivot_and_shaft_define_the_tip_frame():
    rng = np.random.default_rng(4)
    pivot = pivot_scene(rng, 60, cone_deg=60.0, noise=None)
    result = calibrate_pivot(pivot.poses)
    shaft = np.array([0.3, -0.5, 0.8])
    tool_from_tip = result.tool_from_tip("tool_tip", shaft)
    np.testing.assert_allclose(
        tool_from_tip.rotate([0.0, 0, 1]), shaft / np.linalg.norm(shaft), atol=1e-12
    )
    assert tool_from_tip.rotation[0, 0] > 0.0, "+x is on the side of the tool's x-axis"


def test_degenerate_poses_raise_specific_errors():
    rng = np.random.default_rng(5)
    scene = pivot_scene(rng, 30, cone_deg=0.0, noise=None, spin_deg=60.0)
    still = pivot_scene(rng, 30, cone_deg=0.0, noise=EM_NOISE, spin_deg=4.0)
    beside = np.cross(scene.tip_mm, [1.0, 2.0, 3.0])
    for error, message, poses, tip_mm in (
        (TooFewError, "9 poses for a spin", scene.poses[:9], scene.tip_mm),
        (DegenerateMotionError, "one pose repeated", [scene.poses[0]] * 20, scene.tip_mm),
        (DegenerateMotionError, "expected at least 15", still.poses, scene.tip_mm),
        (DegenerateMotionError, "across the line to the tip", scene.poses, beside),
    ):
        with pytest.raises(error, match=message):
            calibrate_spin(poses, tip_mm=tip_mm)
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
def test_tip_that_does_not_determine_the_sign_is_rejected(tip, error):
    scene = pivot_scene(np.random.default_rng(6), 20, cone_deg=0.0, noise=None, spin_deg=60.0)
    with pytest.raises(error):
        calibrate_spin(scene.poses, tip_mm=tip)
