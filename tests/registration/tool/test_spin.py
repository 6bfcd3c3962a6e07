from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from app.geometry import FloatArray, Transform
from app.registration import (
    DegenerateMotionError,
    NotFiniteError,
    PoseNoise,
    ShapeError,
    TooFewError,
    calibrate_pivot,
    calibrate_spin,
)
from tests.registration.helpers import pivot_scene

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


def smallest_eigenvector(poses: list[Transform]) -> FloatArray:
    """The peer's spin: sum of (R - 1)^T (R - 1) over successive poses."""
    scatter = np.zeros((3, 3))
    for first, second in pairwise(poses):
        change = first.rotation.T @ second.rotation - np.eye(3)
        scatter += change.T @ change
    return np.linalg.eigh(scatter)[1][:, 0]


def angle_deg(one: FloatArray, other: FloatArray) -> float:
    unit = one / np.linalg.norm(one), other / np.linalg.norm(other)
    return float(np.degrees(np.arcsin(min(1.0, np.linalg.norm(np.cross(*unit))))))


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), spin=st.floats(15.0, 180.0))
def test_noise_free_poses_give_the_shaft_and_its_sense(seed: int, spin: float) -> None:
    scene = pivot_scene(np.random.default_rng(seed), 25, cone_deg=0.0, noise=None, spin_deg=spin)
    result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
    assert np.abs(result.shaft - scene.tip_mm / np.linalg.norm(scene.tip_mm)).max() < 1e-10
    backwards = calibrate_spin(scene.poses, tip_mm=-scene.tip_mm)
    np.testing.assert_array_equal(backwards.shaft, -result.shaft)


def test_noise_and_wrong_poses() -> None:
    rng = np.random.default_rng(1)
    ours, peers = [], []
    for _ in range(25):
        scene = pivot_scene(rng, 60, cone_deg=0.0, noise=EM_NOISE, spin_deg=60.0, wrong_share=0.2)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        assert result.accepted, result.reason
        ours.append(angle_deg(result.shaft, scene.tip_mm))
        peers.append(angle_deg(smallest_eigenvector(scene.poses), scene.tip_mm))
    assert max(ours) < 0.3 < np.mean(peers)


def test_covariance_is_calibrated() -> None:
    rng = np.random.default_rng(2)
    trials, errors = 80, []
    for _ in range(trials):
        scene = pivot_scene(rng, 60, cone_deg=0.0, noise=EM_NOISE, spin_deg=40.0)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        across = np.linalg.svd(result.shaft[None])[2][1:]
        error = across @ (scene.tip_mm / np.linalg.norm(scene.tip_mm) - result.shaft)
        errors.append(error @ np.linalg.solve(across @ result.covariance @ across.T, error))
    low, high = chi2.ppf([0.001, 0.999], 2 * trials) / trials
    assert low < np.mean(errors) < high


def test_a_pivot_taken_for_a_spin_is_never_accepted() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        scene = pivot_scene(rng, 60, cone_deg=50.0, noise=EM_NOISE)
        try:
            result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        except DegenerateMotionError as refusal:
            assert "not turned about its shaft" in str(refusal)
        else:
            assert not result.accepted and "degrees allowed" in result.reason


def test_spin_and_pivot_make_the_tip_frame() -> None:
    rng = np.random.default_rng(4)
    pivot = pivot_scene(rng, 60, cone_deg=60.0, noise=None)
    result = calibrate_pivot(pivot.poses)
    shaft = np.array([0.3, -0.5, 0.8])
    tool_from_tip = result.tool_from_tip("tool_tip", shaft)
    np.testing.assert_allclose(
        tool_from_tip.rotate([0.0, 0, 1]), shaft / np.linalg.norm(shaft), atol=1e-12
    )
    assert tool_from_tip.rotation[0, 0] > 0.0, "+x stays on the side of the tool's own x-axis"


def test_poses_that_say_nothing_of_the_shaft_are_refused_by_name() -> None:
    rng = np.random.default_rng(5)
    scene = pivot_scene(rng, 30, cone_deg=0.0, noise=None, spin_deg=60.0)
    with pytest.raises(TooFewError, match="9 poses for a spin"):
        calibrate_spin(scene.poses[:9], tip_mm=scene.tip_mm)
    with pytest.raises(DegenerateMotionError, match="one pose repeated"):
        calibrate_spin([scene.poses[0]] * 20, tip_mm=scene.tip_mm)
    with pytest.raises(DegenerateMotionError, match="15 wanted"):
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
def test_a_tip_that_gives_no_sense_of_the_shaft_is_refused(
    tip: list[float], error: type[Exception]
) -> None:
    scene = pivot_scene(np.random.default_rng(6), 20, cone_deg=0.0, noise=None, spin_deg=60.0)
    with pytest.raises(error):
        calibrate_spin(scene.poses, tip_mm=tip)
