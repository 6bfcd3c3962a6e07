"""The two ways of following: the same result, and what is wrong said in words."""

import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.bridge.robots import FollowError, JointFollower, RobotSettings, TfFollower
from app.bridge.tf import TransformBuffer
from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.robot import bodies_from_mesh_map, robot_from_text
from tests.bridge.robots.conftest import URDF

NOW_NS = 1_700_000_000 * NS_PER_S
ARM = RobotSettings("arm")


def insert(buffer, transform, stamp_ns, *, static=False):
    pose = (*transform.translation_mm.tolist(), *transform.quaternion_xyzw.tolist())
    buffer.insert(transform.target, transform.source, stamp_ns, pose, static=static)


def publish_fk(buffer, robot, positions, stamp_ns, settings=ARM):
    """What a robot_state_publisher sends: an edge a joint."""
    links = robot.forward_kinematics(positions)
    for joint in robot.joints:
        edge = links[joint.parent].inverse() @ links[joint.child]
        named = edge.renamed(
            target=settings.frame(joint.parent), source=settings.frame(joint.child)
        )
        insert(buffer, named, stamp_ns, static=not joint.moves)


@given(
    turn=st.floats(-3, 3),
    push=st.floats(-1, 1),
    is_reversed=st.booleans(),
    has_fixed_frame=st.booleans(),
)
def test_tf_and_joint_states_give_the_same_state(turn, push, is_reversed, has_fixed_frame):
    robot, buffer = robot_from_text(URDF), TransformBuffer()
    settings = RobotSettings("r", tf_prefix="left", fixed_frame="room" if has_fixed_frame else "")
    room_from_base = Transform.from_rotation_vector(
        [0.3, -0.2, 1.0], [100.0, 20.0, -5.0], target="room", source="left/base"
    )
    insert(buffer, room_from_base, 0, static=True)
    publish_fk(buffer, robot, {"turn": turn, "push": push}, NOW_NS, settings)
    by_tf = TfFollower(robot, settings, buffer).state(NOW_NS)
    joints = JointFollower(robot, settings, buffer)
    names, positions = ["turn", "push"], [turn, push]
    if is_reversed:
        names, positions = names[::-1], positions[::-1]
    joints.take(names, positions, NOW_NS)
    by_joints = joints.state(NOW_NS)
    assert by_tf.root == by_joints.root == ("room" if has_fixed_frame else "left/base")
    assert by_tf.links == by_joints.links == tuple(link.name for link in robot.links)
    assert by_tf.stamp_ns == by_joints.stamp_ns == NOW_NS
    assert not (by_tf.is_stale or by_joints.is_stale or by_tf.problems or by_joints.problems)
    np.testing.assert_allclose(by_tf.poses, by_joints.poses, rtol=0, atol=1e-9)
    assert not by_joints.poses.flags.writeable


def test_the_mimic_joint_follows_its_leader_by_the_formula(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["push", "turn"], [0.0, 0.25], NOW_NS)
    state = follower.state(NOW_NS)
    finger = state.poses[state.links.index("finger")]
    assert math.atan2(finger[2, 1], finger[1, 1]) == pytest.approx(-2 * 0.25 + 0.5)


@pytest.mark.parametrize(
    ("names", "positions", "stamp_ns", "message"),
    [
        (["turn"], [0.1], NOW_NS, "joints without a position: push"),
        (["turn", "push"], [0.1], NOW_NS, "2 names and 1 positions"),
        (["turn", "turn"], [0.1, 0.2], NOW_NS, "a joint twice"),
        (["turn", "push"], [0.1, 0.2], 0, "has the stamp 0"),
        (["turn", "push"], [math.nan, 0.2], NOW_NS, "joints without a position: turn"),
    ],
)
def test_a_robot_that_was_never_told_everything_has_no_poses(
    robot, names, positions, stamp_ns, message
):
    follower = JointFollower(robot, ARM)
    follower.take(names, positions, stamp_ns)
    state = follower.state(NOW_NS)
    assert state.is_stale
    assert state.poses is None
    assert message in "; ".join(state.problems)


@pytest.mark.parametrize("position", [math.nan, math.inf])
def test_a_position_that_is_no_number_makes_stale_until_one_that_is(robot, position):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    good = follower.state(NOW_NS).poses
    follower.take(["turn", "push"], [position, 0.3], NOW_NS + 1)
    state = follower.state(NOW_NS + 1)
    assert state.is_stale
    assert state.problems == ("joints whose position is no number: turn",)
    np.testing.assert_array_equal(state.poses, good)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS + 2)
    assert not follower.state(NOW_NS + 2).is_stale


def test_a_joint_that_falls_silent_makes_stale_by_name(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    later_ns = NOW_NS + 501 * NS_PER_MS
    follower.take(["turn"], [0.4], later_ns)
    state = follower.state(later_ns)
    assert state.is_stale
    assert state.stamp_ns == NOW_NS
    assert state.problems == ("the state is 501 ms old; expected at most 500 ms (joint 'push')",)


def test_joints_of_others_are_said_and_do_no_harm(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "wheel", "push"], [0.1, math.nan, 0.2], NOW_NS)
    state = follower.state(NOW_NS)
    assert not state.is_stale
    assert state.problems == ("joints that the robot has not: wheel",)


def test_parts_of_a_robot_may_come_in_messages_of_their_own(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn"], [0.1], NOW_NS)
    follower.take(["push"], [0.2], NOW_NS + 3 * NS_PER_MS)
    state = follower.state(NOW_NS + 4 * NS_PER_MS)
    assert (state.is_stale, state.stamp_ns) == (False, NOW_NS)


def test_a_late_message_is_left_out_and_a_source_that_begins_anew_is_not(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    fresh = follower.state(NOW_NS).poses
    follower.take(["turn", "push"], [0.5, 0.6], NOW_NS - 10 * NS_PER_MS)
    np.testing.assert_array_equal(follower.state(NOW_NS).poses, fresh)
    follower.take(["turn", "push"], [0.5, 0.6], NOW_NS - 10 * NS_PER_S)
    assert follower.state(NOW_NS - 10 * NS_PER_S).stamp_ns == NOW_NS - 10 * NS_PER_S


def test_a_state_from_the_future_is_stale(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS + NS_PER_S)
    assert "1000 ms in the future" in follower.state(NOW_NS).problems[0]


def test_a_flood_of_names_stays_small(robot):
    follower = JointFollower(robot, ARM)
    for number in range(200):
        names = [f"{number}-{index}" for index in range(100)]
        follower.take(names, [0.0] * 100, NOW_NS)
    assert len(follower._samples) == 0
    assert all(len(problem) < 400 for problem in follower.state(NOW_NS).problems)


def test_a_fixed_frame_without_tf_is_said(robot):
    follower = JointFollower(robot, RobotSettings("r", fixed_frame="room"))
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    assert "where 'base' is in 'room': tf wanted" in follower.state(NOW_NS).problems[0]


def test_tf_that_stops_or_never_was_is_said_and_the_last_poses_stay(robot):
    buffer = TransformBuffer()
    follower = TfFollower(robot, ARM, buffer)
    before = follower.state(NOW_NS)
    assert (before.is_stale, before.poses) == (True, None)
    assert "frame 'base' is not known" in before.problems[0]
    publish_fk(buffer, robot, {"turn": 0.1}, NOW_NS)
    assert not follower.state(NOW_NS).is_stale
    late = follower.state(NOW_NS + NS_PER_S)
    assert late.is_stale
    assert late.poses is not None
    buffer.clear()
    assert follower.state(NOW_NS).poses is not None


@pytest.mark.parametrize(
    "wrong", [{"name": " "}, {"stale_after_ns": 0}, {"tf_prefix": "a b"}, {"namespace": "a//b"}]
)
def test_settings_that_cannot_be_are_refused(wrong):
    from app.geometry import MarginGuardError

    with pytest.raises(MarginGuardError):
        RobotSettings(**{"name": "r", **wrong})
    assert issubclass(FollowError, MarginGuardError)


def test_names_of_a_robot():
    robot = RobotSettings("r", namespace="/left/", tf_prefix="left_")
    assert robot.topic("joint_states") == "/left/joint_states"
    assert robot.topic("/joint_states") == "/joint_states"
    assert robot.frame("base") == "left_/base"
    assert RobotSettings("r", tf_prefix="a/").frame("base") == "a/base"
    assert RobotSettings("r").frame("base") == "base"


def test_bodies_of_ambf_are_placed_by_tf_where_its_file_says(shared_data):
    """From the parameter string alone; the poses are read from the file by yaml and scipy here."""
    folder = shared_data / "ambf_kuka"
    said = yaml.safe_load((folder / "blender-kuka.yaml").read_text())
    bodies = {said[key]["name"]: said[key]["location"] for key in said["bodies"]}
    meshes = folder / "meshes" / "low_res"
    robot = bodies_from_mesh_map(
        ";".join(f"{name}:{meshes / name}.STL" for name in bodies), allowed_dirs=[meshes]
    )
    buffer, wanted = TransformBuffer(), {"world": np.eye(4)}
    for name, location in bodies.items():
        wanted[name] = np.eye(4)
        turn = Rotation.from_euler("xyz", [location["orientation"][axis] for axis in "rpy"])
        wanted[name][:3, :3] = turn.as_matrix()
        wanted[name][:3, 3] = [1000.0 * location["position"][axis] for axis in "xyz"]
        pose = (*wanted[name][:3, 3].tolist(), *turn.as_quat().tolist())
        buffer.insert("world", name, NOW_NS, pose)
    state = TfFollower(robot, RobotSettings("ambf"), buffer).state(NOW_NS)
    assert (state.root, state.is_stale, len(state.links)) == ("world", False, 9)
    for name, pose in zip(state.links, state.poses, strict=True):
        np.testing.assert_allclose(pose, wanted[name], rtol=0, atol=1e-9)
