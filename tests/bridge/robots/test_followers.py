"""`JointFollower`: the poses of tf, stale states and problems."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from app.bridge.robot_description import RobotSettings
from app.bridge.robots import JointFollower
from app.bridge.ros_errors import FollowError
from app.bridge.tf import TransformBuffer
from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.robot import robot_from_text
from tests.bridge.robots.conftest import URDF

pytestmark = pytest.mark.slow

NOW_NS = 1_700_000_000 * NS_PER_S
ARM = RobotSettings("arm")


def insert(buffer, transform, stamp_ns, *, static=False):
    pose = (*transform.translation_mm.tolist(), *transform.quaternion_xyzw.tolist())
    buffer.insert(transform.target, transform.source, stamp_ns, pose, static=static)


def publish_fk(buffer, robot, positions, stamp_ns, settings=ARM):
    """Insert one edge per joint, as a robot_state_publisher does."""
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
def test_joint_states_give_the_poses_of_tf(turn, push, is_reversed, has_fixed_frame):
    robot, buffer = robot_from_text(URDF), TransformBuffer()
    settings = RobotSettings("r", tf_prefix="left", fixed_frame="room" if has_fixed_frame else "")
    room_from_base = Transform.from_rotation_vector(
        [0.3, -0.2, 1.0], [100.0, 20.0, -5.0], target="room", source="left/base"
    )
    insert(buffer, room_from_base, 0, static=True)
    publish_fk(buffer, robot, {"turn": turn, "push": push}, NOW_NS, settings)
    joints = JointFollower(robot, settings, buffer)
    names, positions = ["turn", "push"], [turn, push]
    if is_reversed:
        names, positions = names[::-1], positions[::-1]
    joints.take(names, positions, NOW_NS)
    state = joints.state(NOW_NS)
    assert state.links == tuple(link.name for link in robot.links)
    assert state.stamp_ns == NOW_NS
    assert not (state.is_stale or state.problems)
    root = "room" if has_fixed_frame else "left/base"
    for link, pose in zip(state.links, state.poses, strict=True):
        expected = buffer.lookup(root, settings.frame(link)).transform.matrix
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-9)
    assert not state.poses.flags.writeable


def test_mimic_joint_follows_its_formula(robot):
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
        (["turn", "turn"], [0.1, 0.2], NOW_NS, "duplicate joint names"),
        (["turn", "push"], [0.1, 0.2], 0, "has the stamp 0"),
        (["turn", "push"], [math.nan, 0.2], NOW_NS, "joints without a position: turn"),
    ],
)
def test_incomplete_joint_state_gives_no_poses(robot, names, positions, stamp_ns, message):
    follower = JointFollower(robot, ARM)
    follower.take(names, positions, stamp_ns)
    state = follower.state(NOW_NS)
    assert state.is_stale
    assert state.poses is None
    assert message in "; ".join(state.problems)


@pytest.mark.parametrize("position", [math.nan, math.inf])
def test_non_finite_position_makes_the_state_stale(robot, position):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    good = follower.state(NOW_NS).poses
    follower.take(["turn", "push"], [position, 0.3], NOW_NS + 1)
    state = follower.state(NOW_NS + 1)
    assert state.is_stale
    assert state.problems == ("joints whose position is not finite: turn",)
    np.testing.assert_array_equal(state.poses, good)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS + 2)
    assert not follower.state(NOW_NS + 2).is_stale


def test_silent_joint_makes_the_state_stale(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    later_ns = NOW_NS + 501 * NS_PER_MS
    follower.take(["turn"], [0.4], later_ns)
    state = follower.state(later_ns)
    assert state.is_stale
    assert state.stamp_ns == NOW_NS
    assert state.problems == ("the state is 501 ms old; expected at most 500 ms (joint 'push')",)


def test_oversized_joint_state_is_refused(robot):
    follower = JointFollower(robot, ARM)
    seconds, nanoseconds = divmod(NOW_NS, NS_PER_S)
    for name, is_refused in (("wheel", False), ("n" * (1 << 18), True)):
        message = JointState(name=["turn", "push", name], position=[0.1, 0.2, 0.3])
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        before = follower.refused
        follower.receive(serialize_message(message))
        assert follower.refused - before == is_refused
    assert follower.state(NOW_NS).problems == ("joints unknown to the robot: wheel",)


def test_unknown_joints_are_reported_and_ignored(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "wheel", "push"], [0.1, math.nan, 0.2], NOW_NS)
    state = follower.state(NOW_NS)
    assert not state.is_stale
    assert state.problems == ("joints unknown to the robot: wheel",)


def test_joints_may_come_in_separate_messages(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn"], [0.1], NOW_NS)
    follower.take(["push"], [0.2], NOW_NS + 3 * NS_PER_MS)
    state = follower.state(NOW_NS + 4 * NS_PER_MS)
    assert (state.is_stale, state.stamp_ns) == (False, NOW_NS)


def test_late_message_is_ignored_and_restarted_source_is_followed(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    fresh = follower.state(NOW_NS).poses
    follower.take(["turn", "push"], [0.5, 0.6], NOW_NS - 10 * NS_PER_MS)
    np.testing.assert_array_equal(follower.state(NOW_NS).poses, fresh)
    follower.take(["turn", "push"], [0.5, 0.6], NOW_NS - 10 * NS_PER_S)
    assert follower.state(NOW_NS - 10 * NS_PER_S).stamp_ns == NOW_NS - 10 * NS_PER_S


def test_state_from_the_future_is_stale(robot):
    follower = JointFollower(robot, ARM)
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS + NS_PER_S)
    assert "1000 ms in the future" in follower.state(NOW_NS).problems[0]


def test_unknown_names_do_not_accumulate(robot):
    follower = JointFollower(robot, ARM)
    for number in range(200):
        names = [f"{number}-{index}" for index in range(100)]
        follower.take(names, [0.0] * 100, NOW_NS)
    assert len(follower._samples) == 0
    assert all(len(problem) < 400 for problem in follower.state(NOW_NS).problems)


def test_fixed_frame_without_tf_is_a_problem(robot):
    follower = JointFollower(robot, RobotSettings("r", fixed_frame="room"))
    follower.take(["turn", "push"], [0.1, 0.2], NOW_NS)
    assert "the pose of 'base' in 'room' is unknown" in follower.state(NOW_NS).problems[0]


def test_newest_transform_of_the_root_is_used_for_newer_joints(robot):
    buffer = TransformBuffer()
    settings = RobotSettings("r", fixed_frame="room")
    raised = Transform.from_rotation_vector([0, 0, 0], [0, 0, 7], target="room", source="base")
    insert(buffer, raised, NOW_NS)
    follower = JointFollower(robot, settings, buffer)
    limit_ns = settings.stale_after_ns
    for joints_ns, now_ns in ((NOW_NS + 1, NOW_NS + 1), (NOW_NS + limit_ns, NOW_NS + limit_ns)):
        follower.take(["turn", "push"], [0.0, 0.0], joints_ns)
        state = follower.state(now_ns)
        assert (state.is_stale, state.stamp_ns) == (False, NOW_NS)
        assert state.poses[state.links.index("base")][2, 3] == 7.0
    state = follower.state(NOW_NS + limit_ns + 1)
    assert state.is_stale
    assert state.problems[0].endswith("(transform of 'base' in 'room')")


@pytest.mark.parametrize("wrong", [{"name": " "}, {"stale_after_ns": 0}, {"tf_prefix": "a b"}])
def test_invalid_settings_are_refused(wrong):
    from app.geometry import MarginGuardError

    with pytest.raises(MarginGuardError):
        RobotSettings(**{"name": "r", **wrong})
    assert issubclass(FollowError, MarginGuardError)


def test_prefix_of_a_robot():
    assert RobotSettings("r", tf_prefix="left_").frame("base") == "left_/base"
    assert RobotSettings("r", tf_prefix="a/").frame("base") == "a/base"
    assert RobotSettings("r").frame("base") == "base"
