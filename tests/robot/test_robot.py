"""Forward kinematics against Pinocchio, which reads the same files with a parser of its own."""

import math

import numpy as np
import pytest

from app.geometry import FrameError, Transform
from app.robot import JointError, load_robot

# What each adds: UR5 (DAE, tool0), a pendulum (continuous joints), Tiago (a torso that slides, many
# fixed frames). The Panda (mimic) is a fixture.
EXAMPLES = (
    "ur_description/urdf/ur5_robot.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
)


def random_positions(robot, rng):
    return {
        joint.name: rng.uniform(*np.nan_to_num((joint.lower, joint.upper), neginf=-3, posinf=3))
        for joint in robot.joints
        if joint.moves and joint.mimic is None
    }


def assert_agrees_with_pinocchio(urdf, robot, rng, samples=5):
    pin = pytest.importorskip("pinocchio", reason="the pin wheel is not installed")
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    followers = {joint.name: joint.mimic for joint in robot.joints if joint.mimic is not None}
    for _ in range(samples):
        given = random_positions(robot, rng)
        positions = dict(given)
        for name, mimic in followers.items():
            positions[name] = given[mimic.leader] * mimic.multiplier + mimic.offset
        configuration = pin.neutral(model)
        for name, position in positions.items():
            joint = model.joints[model.getJointId(name)]
            value = [position] if joint.nq == 1 else [math.cos(position), math.sin(position)]
            configuration[joint.idx_q : joint.idx_q + joint.nq] = value
        pin.framesForwardKinematics(model, data, configuration)
        root = data.oMf[model.getFrameId(robot.root_link, pin.FrameType.BODY)]
        links = robot.forward_kinematics(given)
        assert set(links) == {link.name for link in robot.links}
        for name, root_from_link in links.items():
            peer = root.actInv(data.oMf[model.getFrameId(name, pin.FrameType.BODY)])
            assert root_from_link.target == robot.root_link
            assert root_from_link.source == name
            # 1e-9 m is 1e-6 mm
            np.testing.assert_allclose(
                root_from_link.translation_mm, 1000.0 * peer.translation, rtol=0, atol=1e-6
            )
            np.testing.assert_allclose(root_from_link.rotation, peer.rotation, rtol=0, atol=1e-9)


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


def test_the_panda_agrees_with_pinocchio(panda_urdf, panda, rng):
    assert panda.warnings == ()
    assert_agrees_with_pinocchio(panda_urdf, panda, rng)


def test_the_pandas_second_finger_follows_the_first(panda):
    robot = panda
    followers = {joint.name: joint.mimic.leader for joint in robot.joints if joint.mimic}
    assert followers == {"panda_finger_joint2": "panda_finger_joint1"}
    assert "panda_finger_joint2" not in robot.actuated_joint_names
    positions = {"panda_finger_joint1": 0.03}
    apart = robot.forward_kinematics(positions)["panda_rightfinger"].translation_mm
    closed = robot.forward_kinematics({})["panda_rightfinger"].translation_mm
    assert np.linalg.norm(apart - closed) == pytest.approx(30.0)


def test_a_joint_that_is_not_given_is_at_zero(touch):
    sparse = touch.forward_kinematics({"elbow": 0.3})
    full = touch.forward_kinematics(dict.fromkeys(touch.actuated_joint_names, 0.0) | {"elbow": 0.3})
    for name, root_from_link in sparse.items():
        np.testing.assert_array_equal(root_from_link.matrix, full[name].matrix)


def test_positions_beyond_the_limits_are_shown_as_measured(touch):
    assert touch.forward_kinematics({"waist": 3.0})["torso"].angle_to(
        Transform.identity("touch_base", "torso")
    ) == pytest.approx(3.0)


@pytest.mark.parametrize("position", [math.nan, math.inf, -math.inf])
def test_positions_that_are_no_numbers_are_refused_by_name(touch, position):
    with pytest.raises(JointError, match=r"'elbow'.*finite"):
        touch.forward_kinematics({"elbow": position})


def test_a_position_that_puts_a_link_beyond_all_numbers_is_refused(panda):
    with pytest.raises(JointError, match=r"'panda_leftfinger' is at .*finite numbers wanted"):
        panda.forward_kinematics({"panda_finger_joint1": 1e306})


def test_links_are_turned_by_rotations_at_any_angle(touch, rng):
    for scale in (1.0, 1e3, 1e9):
        positions = dict(zip(touch.actuated_joint_names, scale * rng.normal(size=6), strict=True))
        for pose in touch.forward_kinematics(positions).values():
            gram = pose.rotation.T @ pose.rotation
            np.testing.assert_allclose(gram, np.eye(3), atol=1e-14)


def test_unknown_joints_are_refused_by_name(touch):
    with pytest.raises(JointError, match=r"'knee'.*unknown.*waist"):
        touch.forward_kinematics({"knee": 0.0})


def test_the_wanted_pose_must_be_of_the_link_in_the_root(touch):
    with pytest.raises(FrameError, match=r"touch_base_from_stylus wanted"):
        touch.inverse_kinematics("stylus", Transform.identity("world", "stylus"))
