"""Robot-world calibration against OpenCV, scipy and known poses."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from app.geometry import FrameError, Transform
from app.registration import (
    AcceptanceLimits,
    DegenerateMotionError,
    NoConsensusError,
    PoseNoise,
    TooFewError,
    UnequalCountsError,
    predict_tre,
    solve_robot_world,
)
from app.registration.pose_stack import PoseStack
from app.registration.robot_world import RobotWorld, closed_form, jacobian_of, residuals_of
from app.registration.small_motion import apply_motion
from tests.oracles.registration_robot_world import opencv_base, scipy_robot_world
from tests.registration.helpers import (
    disturbed,
    motion_between,
    random_transform,
    robot_world_scene,
)

pytestmark = pytest.mark.slow

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 20), known=st.booleans())
def test_noise_free_poses_give_the_true_base_and_mount(seed, count, known):
    rng = np.random.default_rng(seed)
    scene = robot_world_scene(rng, count, None)
    result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE if known else None)
    assert result.registration.transform.angle_to(scene.base) < 1e-10
    assert result.registration.transform.distance_mm_to(scene.base) < 1e-9
    assert result.tip_from_sensor.angle_to(scene.mount) < 1e-10
    assert result.tip_from_sensor.distance_mm_to(scene.mount) < 1e-9
    assert result.registration.outliers == ()


def test_closed_form_agrees_with_opencv():
    rng = np.random.default_rng(1)
    for _ in range(10):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        robot = PoseStack.from_poses(scene.robot, "robot", min_count=4)
        sensor = PoseStack.from_poses(scene.sensor, "sensor", min_count=4)
        ours = closed_form(robot, sensor).reference_from_base
        peer = opencv_base(scene.robot, scene.sensor, cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH)
        np.testing.assert_allclose(ours.rotation, peer.rotation, atol=1e-10)


TARGET_IN_CAMERA = """
0.04964505493834381 0.5136826827431226 0.8565427426404346
-0.3923117691818854 0.7987004864191318 -0.4562554205214679
-0.9184916136152514 -0.3133809733274676 0.2411752915926112
-1.588728904724121 0.07843752950429916 -1.002813339233398
-0.3048000068139332 0.6971848192711539 0.6488684640388026
-0.9377589344241749 -0.3387497187353627 -0.07652979135179161
0.1664486009369332 -0.6318084803439735 0.7570422097951847
-1.906493663787842 -0.07281044125556946 0.6088893413543701
-0.590234879685801 -0.7051138289845309 -0.3929850823848928
0.6017371069678565 -0.7088332765096816 0.3680595606834615
-0.5380847896941907 -0.01923211603859842 0.8426712792141644
-0.9809040427207947 -0.2707894444465637 -0.2577074766159058
0.7643667483125168 -0.08523002870239212 0.63912386614923
-0.2583463792779588 0.8676987164647345 0.424683512464778
-0.5907627462764713 -0.489729292214425 0.6412211770980741
-1.58987033367157 -1.924914002418518 -0.3109001517295837
"""
GRIPPER_IN_BASE = """
-0.4143743581399177 -0.6105088815982459 -0.6749613298595637
-0.1598851232573451 -0.6812625208693498 0.71436554019614
-0.895952364066927 0.4039310376145889 0.1846864320259794
-1.249274406461827 -1.916570771580279 2.005069553422765
0.7262439860936567 -0.201662933718935 -0.6571923111439066
-0.4640017362244384 -0.8491808316335328 -0.2521791108852766
-0.5072199339965884 0.4880819361030014 -0.7102844234575628
-0.7375172846804027 -2.579760910816792 1.336561572270101
0.2541996332132083 0.6186461729765909 0.7434106934499181
0.2194912986375709 0.711701808961156 -0.6673111005698995
-0.9419161938817396 0.3328024155303503 0.04512688689130734
-1.040123533893404 -0.1303773962721222 1.068029475621886
0.116348305340805 -0.9917998080681939 0.0528792261688552
-0.2760629007224059 0.01884966191381591 0.9609547154213178
-0.9540714578526358 -0.1264034452126562 -0.2716060057313114
-2.551899142554571 -2.986937398237611 1.317613923218308
"""
"""Rows of rotations, each followed by its translation."""


def poses_of(text: str, target: str, source: str) -> list[Transform]:
    rows = np.array(text.split(), dtype=float).reshape(-1, 4, 3)
    return [Transform(target, source, pose[:3], pose[3]) for pose in rows]


def test_published_regression_case():
    """OpenCV's hand-eye regression case 24871, known to 1e-12 (without units, here mm)."""
    robot = poses_of(GRIPPER_IN_BASE, "base", "tip")
    sensor = [pose.inverse() for pose in poses_of(TARGET_IN_CAMERA, "sensor", "target")]
    result = solve_robot_world(robot, sensor, noise=EM_NOISE)
    expected = [[0, 0, -1, 0.1], [1, 0, 0, 0.2], [0, -1, 0, 0.3], [0, 0, 0, 1]]
    np.testing.assert_allclose(result.tip_from_sensor.matrix, expected, atol=1e-10)


def test_error_with_em_noise_is_below_that_of_the_closed_forms(sample):
    rng = np.random.default_rng(2)
    errors: dict[str, list[float]] = {"ours": [], "estimated": [], "shah": [], "li": []}
    for _ in range(4 * sample):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        middle = scene.base.inverse().apply(scene.centre_mm)
        poses = scene.robot, scene.sensor
        answers = {
            "ours": solve_robot_world(*poses, noise=EM_NOISE).registration.transform,
            "estimated": solve_robot_world(*poses).registration.transform,
            "shah": opencv_base(*poses, cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH),
            "li": opencv_base(*poses, cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI),
        }
        for name, answer in answers.items():
            errors[name].append(float(np.linalg.norm(answer.apply(middle) - scene.centre_mm)))
    rms = {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in errors.items()}
    assert rms["ours"] < 0.30 and np.quantile(errors["ours"], 0.95) < 0.45
    assert rms["estimated"] < 0.33
    assert rms["ours"] < min(rms["shah"], rms["li"])


def test_jacobian_is_the_derivative_of_large_residuals():
    rng = np.random.default_rng(8)
    scene = robot_world_scene(rng, 5, PoseNoise(0.15, 20.0))
    robot = PoseStack.from_poses(scene.robot, "robot", min_count=4)
    sensor = PoseStack.from_poses(scene.sensor, "sensor", min_count=4)
    state, centre = RobotWorld(scene.base, scene.mount), sensor.translations_mm.mean(axis=0)
    jacobian = jacobian_of(state, robot, residuals_of(state, robot, sensor), centre)
    for column in range(12):
        step = np.zeros(12)
        step[column] = 1e-6
        moved = (
            RobotWorld(
                apply_motion(scene.base, each[:6], centre),
                apply_motion(scene.mount, each[6:], np.zeros(3)),
            )
            for each in (step, -step)
        )
        ahead, behind = (residuals_of(each, robot, sensor) for each in moved)
        # The series of the inverse right Jacobian is truncated after the second order.
        np.testing.assert_allclose(jacobian[..., column], (behind - ahead) / 2e-6, atol=1e-3)


def test_covariance_is_calibrated(sample):
    rng = np.random.default_rng(3)
    trials, errors = 6 * sample, []
    for _ in range(trials):
        scene = robot_world_scene(rng, 9, EM_NOISE)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        of_base = motion_between(scene.base, result.registration.transform)
        motion = np.concatenate([of_base, motion_between(scene.mount, result.tip_from_sensor)])
        errors.append(motion @ np.linalg.solve(result.covariance, motion))
    low, high = chi2.ppf([0.005, 0.995], 12 * trials) / trials
    assert low < np.mean(errors) < high


def test_small_clean_set_rarely_loses_a_pose(sample):
    """Otherwise the predicted target error would be too small."""
    rng = np.random.default_rng(6)
    losses = 0
    for _ in range(3 * sample):
        scene = robot_world_scene(rng, 7, EM_NOISE)
        losses += bool(solve_robot_world(scene.robot, scene.sensor).registration.outliers)
    assert losses <= sample


def test_noise_is_estimated():
    rng = np.random.default_rng(4)
    scene = robot_world_scene(rng, 80, EM_NOISE)
    result = solve_robot_world(scene.robot, scene.sensor)
    found, used = result.noise, 80 - len(result.registration.outliers)
    assert result.registration.degrees_of_freedom == 6 * used - 12, "12 numbers were fitted"
    assert found.rotation_rad == pytest.approx(EM_NOISE.rotation_rad, rel=0.1)
    assert found.translation_mm == pytest.approx(EM_NOISE.translation_mm, rel=0.1)


@pytest.mark.parametrize("known", [True, False])
def test_wrong_poses_are_rejected(known, sample):
    rng = np.random.default_rng(5 + known)
    for _ in range(2 * sample):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        wrong = sorted(rng.choice(15, 3, replace=False).tolist())
        sensor = list(scene.sensor)
        for pose in wrong:
            sensor[pose] = disturbed(rng, sensor[pose], PoseNoise(0.3, 20.0))
        found = solve_robot_world(
            scene.robot, sensor, noise=EM_NOISE if known else None, targets_mm=[scene.centre_mm]
        ).registration
        assert set(wrong) <= set(found.outliers) and len(found.outliers) <= 4
        assert np.isnan(found.leave_one_out_mm[wrong]).all()
        assert found.accepted, found.reason
        error = found.transform.apply(scene.base.inverse().apply(scene.centre_mm))
        error = error - scene.centre_mm
        assert np.linalg.norm(error) < 4.0 * predict_tre(found, [scene.centre_mm])[0]


def test_majority_of_wrong_poses_is_an_error():
    rng = np.random.default_rng(6)
    scene = robot_world_scene(rng, 10, None)
    sensor = [random_transform(rng, "reference", "sensor") for _ in scene.sensor]
    with pytest.raises(NoConsensusError):
        solve_robot_world(scene.robot, sensor, noise=EM_NOISE)


@pytest.mark.parametrize(
    ("vectors", "message"),
    [
        (np.outer(np.linspace(-1, 1, 8), [0.2, 0.3, 0.9]), "parallel axes"),
        (np.random.default_rng(8).normal(scale=0.02, size=(8, 3)), "degrees; expected at least 15"),
        (np.zeros((8, 3)), "rotate by at most"),
    ],
)
def test_motion_that_does_not_determine_the_base_is_rejected(vectors, message):
    rng = np.random.default_rng(7)
    robot = [
        Transform.from_rotation_vector(v, rng.uniform(-90, 90, 3), target="base", source="tip")
        for v in vectors
    ]
    base = random_transform(rng, "reference", "base")
    mount = random_transform(rng, "tip", "sensor", 40.0)
    with pytest.raises(DegenerateMotionError, match=message):
        solve_robot_world(robot, [base @ pose @ mount for pose in robot])


def test_invalid_pose_lists_raise_specific_errors():
    rng = np.random.default_rng(10)
    scene = robot_world_scene(rng, 6, None)
    with pytest.raises(DegenerateMotionError, match="one pose repeated"):
        solve_robot_world([scene.robot[0]] * 6, [scene.sensor[0]] * 6)
    with pytest.raises(UnequalCountsError, match="6 robot poses and 5 sensor poses"):
        solve_robot_world(scene.robot, scene.sensor[:5])
    with pytest.raises(TooFewError, match="3 poses for the robot's tip; expected at least 4"):
        solve_robot_world(scene.robot[:3], scene.sensor[:3])
    with pytest.raises(FrameError, match="different frames"):
        solve_robot_world([*scene.robot[:5], scene.robot[5].renamed(target="other")], scene.sensor)


def test_target_error_decides_acceptance():
    rng = np.random.default_rng(11)
    scene = robot_world_scene(rng, 15, EM_NOISE)
    away, limits = [scene.centre_mm + 3000.0], AcceptanceLimits(tre_mm=1.0)
    near = solve_robot_world(scene.robot, scene.sensor, targets_mm=[scene.centre_mm]).registration
    far = solve_robot_world(scene.robot, scene.sensor, targets_mm=away, limits=limits).registration
    assert near.accepted and not far.accepted
    assert near.fre_mm == far.fre_mm
    assert "target 0" in far.reason


def test_agrees_with_scipy_on_the_same_likelihood():
    rng = np.random.default_rng(12)
    scene = robot_world_scene(rng, 10, EM_NOISE)
    peer = scipy_robot_world(scene.robot, scene.sensor, EM_NOISE, scene.base, scene.mount)
    ours = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
    np.testing.assert_allclose(ours.registration.transform.rotation_vector, peer[:3], atol=1e-7)
    np.testing.assert_allclose(ours.registration.transform.translation_mm, peer[3:6], atol=1e-4)
    np.testing.assert_allclose(ours.tip_from_sensor.translation_mm, peer[9:], atol=1e-4)
