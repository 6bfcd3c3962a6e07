"""Forward kinematics of known robots, compared with Pinocchio."""

import math

import numpy as np
import pytest

from app.geometry import FrameError, Transform
from app.robot import JointError, load_robot
from tests.oracles.pinocchio_kinematics import assert_agrees_with_pinocchio

# UR5: DAE meshes and a tool frame. Pendulum: continuous joints. Tiago: a prismatic torso and many
# fixed frames. The Panda, with a mimic joint, is a fixture.
EXAMPLES = (
    "ur_description/urdf/ur5_robot.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
)


def test_touch_agrees_with_pinocchio(touch_urdf, touch, rng):
    assert_agrees_with_pinocchio(touch_urdf, touch, rng, samples=20)


def test_omni_has_all_visuals_and_agrees_with_pinocchio(shared_data, rng):
    urdf = shared_data / "omni" / "urdf" / "omni.urdf"
    robot = load_robot(urdf)
    assert [len(link.visuals) for link in robot.links] == [1] * 7
    assert robot.warnings == ()
    assert robot.root_link == "base"
    assert robot.actuated_joint_names == ("waist", "shoulder", "elbow", "yaw", "pitch", "roll")
    assert_agrees_with_pinocchio(urdf, robot, rng, samples=20)


@pytest.mark.parametrize("name", EXAMPLES)
def test_known_robots_agree_with_pinocchio(example_robots, name, rng):
    urdf = example_robots / name
    robot = load_robot(urdf)
    assert robot.warnings == ()
    assert_agrees_with_pinocchio(urdf, robot, rng)


def test_panda_agrees_with_pinocchio(panda_urdf, panda, rng):
    assert panda.warnings == ()
    assert_agrees_with_pinocchio(panda_urdf, panda, rng)


def test_mimic_joint_of_the_panda_follows_its_leader(panda):
    robot = panda
    followers = {joint.name: joint.mimic.leader for joint in robot.joints if joint.mimic}
    assert followers == {"panda_finger_joint2": "panda_finger_joint1"}
    assert "panda_finger_joint2" not in robot.actuated_joint_names
    positions = {"panda_finger_joint1": 0.03}
    apart = robot.forward_kinematics(positions)["panda_rightfinger"].translation_mm
    closed = robot.forward_kinematics({})["panda_rightfinger"].translation_mm
    assert np.linalg.norm(apart - closed) == pytest.approx(30.0)


def test_joint_without_position_is_at_zero(touch):
    sparse = touch.forward_kinematics({"elbow": 0.3})
    full = touch.forward_kinematics(dict.fromkeys(touch.actuated_joint_names, 0.0) | {"elbow": 0.3})
    for name, root_from_link in sparse.items():
        np.testing.assert_array_equal(root_from_link.matrix, full[name].matrix)


def test_forward_kinematics_does_not_apply_limits(touch):
    turned = touch.forward_kinematics({"waist": 3.0})["torso"]
    assert turned.angle_to(Transform.identity("touch_base", "torso")) == pytest.approx(3.0)


@pytest.mark.parametrize("position", [math.nan, math.inf, -math.inf])
def test_position_that_is_not_finite_is_refused_by_name(touch, position):
    with pytest.raises(JointError, match=r"'elbow'.*finite"):
        touch.forward_kinematics({"elbow": position})


def test_position_that_makes_a_pose_overflow_is_refused(panda):
    with pytest.raises(JointError, match=r"'panda_leftfinger' is at .*expected finite numbers"):
        panda.forward_kinematics({"panda_finger_joint1": 1e306})


def test_link_rotations_are_orthonormal_at_any_angle(touch, rng):
    for scale in (1.0, 1e3, 1e9):
        positions = dict(zip(touch.actuated_joint_names, scale * rng.normal(size=6), strict=True))
        for pose in touch.forward_kinematics(positions).values():
            gram = pose.rotation.T @ pose.rotation
            np.testing.assert_allclose(gram, np.eye(3), atol=1e-14)


def test_unknown_joint_is_refused_by_name(touch):
    with pytest.raises(JointError, match=r"'knee'.*unknown.*waist"):
        touch.forward_kinematics({"knee": 0.0})


def test_goal_pose_with_other_frames_is_refused(touch):
    with pytest.raises(FrameError, match=r"expected touch_base_from_stylus"):
        touch.inverse_kinematics("stylus", Transform.identity("world", "stylus"))
