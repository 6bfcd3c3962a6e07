"""Pivot calibration: accuracy, outliers, covariance, degenerate poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from app.geometry import FrameError
from app.registration import (
    DegenerateMotionError,
    NoConsensusError,
    PoseNoise,
    ShapeError,
    TooFewError,
    calibrate_pivot,
)
from app.registration.pivot_fit import NOMINAL_NOISE, fit_linear, fit_with_noise_estimate
from app.registration.pose_stack import PoseStack
from tests.oracles.registration_tool import least_squares_pivot
from tests.registration.helpers import pivot_scene, random_transform

pytestmark = pytest.mark.slow

POSITION_NOISE = PoseNoise.from_rms(rotation_deg=1e-6, translation_mm=0.5)
EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), cone=st.floats(31.0, 120.0), known=st.booleans())
def test_noise_free_poses_give_the_true_tip(seed, cone, known):
    scene = pivot_scene(np.random.default_rng(seed), 30, cone_deg=cone, noise=None)
    result = calibrate_pivot(scene.poses, noise=EM_NOISE if known else None)
    assert np.abs(result.tip_mm - scene.tip_mm).max() < 1e-9
    assert np.abs(result.pivot_mm - scene.pivot_mm).max() < 1e-9
    assert result.outliers == ()


@pytest.mark.parametrize("noise", [POSITION_NOISE, EM_NOISE])
def test_outliers_in_a_wide_cone_are_rejected(noise, sample):
    rng = np.random.default_rng(1)
    ours, peers = [], []
    for _ in range(2 * sample):
        scene = pivot_scene(rng, 150, cone_deg=60.0, noise=noise, wrong_share=0.2)
        result = calibrate_pivot(scene.poses)
        assert result.accepted, result.reason
        assert set(scene.wrong) <= set(result.outliers)
        assert len(result.outliers) <= len(scene.wrong) + 3
        ours.append(np.linalg.norm(result.tip_mm - scene.tip_mm))
        peers.append(np.linalg.norm(least_squares_pivot(scene.poses) - scene.tip_mm))
    assert max(ours) < (0.3 if noise is POSITION_NOISE else 0.45)
    assert np.mean(ours) < 0.2 * np.mean(peers)


@pytest.mark.parametrize("noise", [POSITION_NOISE, EM_NOISE])
def test_narrow_cone_is_not_accepted_and_its_covariance_holds(noise, sample):
    """Also with a small RMS residual."""
    rng = np.random.default_rng(2)
    covered, rms, trials = 0, [], 5 * sample
    for _ in range(trials):
        scene = pivot_scene(rng, 60, cone_deg=20.0, noise=noise, wrong_share=0.2)
        result = calibrate_pivot(scene.poses)
        assert not result.accepted and "swings over" in result.reason
        error = result.tip_mm - scene.tip_mm
        squared = error @ np.linalg.solve(result.covariance[:3, :3], error)
        covered += bool(squared < chi2.ppf(0.95, 3))
        rms.append(result.rms_mm)
    assert np.mean(rms) < 0.9, "the residual is as small as that of a wide cone"
    assert covered / trials >= 0.85


def test_rotation_noise_does_not_bias_the_tip(sample):
    rng = np.random.default_rng(3)
    ours, peers = [], []
    for _ in range(15 * sample):
        noise = PoseNoise.from_rms(rotation_deg=1.0, translation_mm=0.3)
        scene = pivot_scene(rng, 80, cone_deg=35.0, noise=noise)
        along = scene.tip_mm / np.linalg.norm(scene.tip_mm)
        ours.append(float((calibrate_pivot(scene.poses).tip_mm - scene.tip_mm) @ along))
        peers.append(float((least_squares_pivot(scene.poses) - scene.tip_mm) @ along))
    # Plain least squares is biased towards the sensor.
    assert np.mean(peers) < -4.0 * np.std(peers) / np.sqrt(len(peers))
    assert abs(np.mean(ours)) < 3.0 * np.std(ours) / np.sqrt(len(ours))


def test_rotation_and_translation_noise_are_estimated():
    scene = pivot_scene(np.random.default_rng(4), 600, cone_deg=60.0, noise=EM_NOISE)
    found = calibrate_pivot(scene.poses).noise
    assert found.rotation_rad == pytest.approx(EM_NOISE.rotation_rad, rel=0.1)
    assert found.translation_mm == pytest.approx(EM_NOISE.translation_mm, rel=0.1)


def test_condition_and_swing_reflect_the_cone():
    rng = np.random.default_rng(5)
    wide = calibrate_pivot(pivot_scene(rng, 80, cone_deg=90.0, noise=EM_NOISE).poses)
    narrow = calibrate_pivot(pivot_scene(rng, 80, cone_deg=25.0, noise=EM_NOISE).poses)
    assert narrow.condition > 3.0 * wide.condition
    assert np.degrees(wide.swing_rad) == pytest.approx(90.0, abs=10.0)
    assert np.degrees(narrow.swing_rad) == pytest.approx(25.0, abs=4.0)
    assert narrow.tip_sigma_mm > 2.0 * wide.tip_sigma_mm


def test_sigma_above_its_limit_is_not_accepted():
    scene = pivot_scene(np.random.default_rng(6), 40, cone_deg=60.0, noise=EM_NOISE)
    result = calibrate_pivot(scene.poses, max_tip_sigma_mm=0.05)
    assert not result.accepted and "expected at most 0.05 mm" in result.reason


def test_tip_frame_has_origin_at_the_tip_and_z_along_the_shaft():
    scene = pivot_scene(np.random.default_rng(7), 40, cone_deg=60.0, noise=None)
    tool_from_tip = calibrate_pivot(scene.poses).tool_from_tip("tool_tip")
    assert (tool_from_tip.target, tool_from_tip.source) == ("tool", "tool_tip")
    np.testing.assert_allclose(tool_from_tip.apply([0.0, 0, 0]), scene.tip_mm, atol=1e-9)
    shaft = scene.tip_mm / np.linalg.norm(scene.tip_mm)
    np.testing.assert_allclose(tool_from_tip.rotate([0.0, 0, 1]), shaft, atol=1e-9)


def test_degenerate_poses_raise_specific_errors():
    rng = np.random.default_rng(8)
    scene = pivot_scene(rng, 30, cone_deg=60.0, noise=EM_NOISE)
    still = pivot_scene(rng, 30, cone_deg=5.0, noise=EM_NOISE, spin_deg=1.0).poses
    spun = pivot_scene(rng, 30, cone_deg=0.0, noise=None, spin_deg=60.0).poses
    anywhere = [random_transform(rng, "reference", "tool") for _ in range(40)]
    mixed = [*scene.poses[:-1], scene.poses[-1].renamed(source="other")]
    for error, message, poses in (
        (TooFewError, "9 poses for a pivot; expected at least 10", scene.poses[:9]),
        (DegenerateMotionError, "one pose repeated", [scene.poses[0]] * 30),
        (DegenerateMotionError, "degrees; expected at least 15", still),
        (DegenerateMotionError, "one axis only", spun),
        (FrameError, "different frames", mixed),
    ):
        with pytest.raises(error, match=message):
            calibrate_pivot(poses)
    with pytest.raises(NoConsensusError, match="poses of a pivot"):
        calibrate_pivot(anywhere, noise=EM_NOISE)
    with pytest.raises(ShapeError, match="max_tip_sigma_mm"):
        calibrate_pivot(scene.poses, max_tip_sigma_mm=0.0)


def test_noise_estimate_of_few_poses_is_unbiased(sample):
    """The estimate accounts for the six fitted parameters."""
    rng = np.random.default_rng(31)
    found = []
    for _ in range(12 * sample):
        scene = pivot_scene(rng, 10, cone_deg=60.0, noise=EM_NOISE)
        poses = PoseStack.from_poses(scene.poses, "a pivot", min_count=10)
        noise = fit_with_noise_estimate(poses, fit_linear(poses, NOMINAL_NOISE)).noise
        found.append((noise.translation_mm**2, noise.rotation_rad**2))
    expected = np.square([EM_NOISE.translation_mm, EM_NOISE.rotation_rad])
    np.testing.assert_allclose(np.mean(found, axis=0) / expected, 1.0, atol=0.3 / np.sqrt(sample))
