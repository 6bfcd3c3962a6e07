"""Inverse kinematics: forward kinematics of the solution gives the goal pose."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.geometry import Transform
from app.robot import IkOptions, Joint, JointError, JointType, Link, Mimic, Robot, UnreachableError
from app.robot.inverse_kinematics import _Problem

fractions = st.lists(st.floats(0.02, 0.98), min_size=6, max_size=6)


def within_limits(robot, positions):
    return all(
        joint.lower <= positions[joint.name] <= joint.upper
        for joint in robot.joints
        if joint.name in positions
    )


@settings(max_examples=15)
@given(fractions)
def test_solution_reaches_any_pose_of_the_arm(touch, fractions):
    positions = {
        joint.name: joint.lower + fraction * (joint.upper - joint.lower)
        for joint, fraction in zip(touch.joints, fractions, strict=True)
    }
    goal = touch.forward_kinematics(positions)["stylus"]
    found = touch.inverse_kinematics("stylus", goal)
    reached = touch.forward_kinematics(found)["stylus"]
    assert reached.distance_mm_to(goal) < 1e-6
    assert reached.angle_to(goal) < 1e-8
    assert within_limits(touch, found)


def test_solution_moves_a_link_through_a_mimic_joint(panda, rng):
    robot = panda
    for _ in range(5):
        positions = {
            joint.name: rng.uniform(joint.lower, joint.upper)
            for joint in robot.joints
            if joint.moves and joint.mimic is None
        }
        # The finger is moved by a mimic joint.
        goal = robot.forward_kinematics(positions)["panda_rightfinger"]
        found = robot.inverse_kinematics("panda_rightfinger", goal)
        assert set(found) == set(robot.actuated_joint_names)
        assert within_limits(robot, found)
        reached = robot.forward_kinematics(found)["panda_rightfinger"]
        assert reached.distance_mm_to(goal) < 1e-6


def test_solution_stays_on_the_branch_of_its_seed(touch):
    path = [
        {"waist": 0.3 * math.sin(t), "shoulder": 0.5, "elbow": 0.2 * t, "yaw": t - 0.5}
        for t in np.linspace(0.0, 1.0, 30)
    ]
    seed = path[0]
    for goal_positions in path:
        goal = touch.forward_kinematics(goal_positions)["stylus"]
        seed = touch.inverse_kinematics("stylus", goal, seed=seed, options=IkOptions(restarts=0))
        for name, position in goal_positions.items():
            assert seed[name] == pytest.approx(position, abs=1e-6)


def test_solution_is_deterministic(touch):
    goal = touch.forward_kinematics({"waist": 0.4, "elbow": -0.3, "pitch": 0.8})["stylus"]
    first = touch.inverse_kinematics("stylus", goal)
    assert touch.inverse_kinematics("stylus", goal) == first


def test_joints_that_do_not_move_the_link_keep_their_seed(touch):
    goal = touch.forward_kinematics({"waist": 0.4})["torso"]
    found = touch.inverse_kinematics("torso", goal, seed={"elbow": 0.7})
    assert found == pytest.approx(
        {"waist": 0.4, "shoulder": 0, "elbow": 0.7, "yaw": 0, "pitch": 0, "roll": 0}
    )


def test_unreachable_pose_is_reported_with_its_distance(touch):
    far = Transform("touch_base", "stylus", np.eye(3), np.array([1000.0, 0.0, 150.0]))
    with pytest.raises(UnreachableError, match=r"'stylus'.*1000.*nearest pose is \d+ mm"):
        touch.inverse_kinematics("stylus", far, options=IkOptions(restarts=2, max_iterations=50))


def test_limits_hold_for_a_pose_just_beyond_them(touch):
    beyond = touch.forward_kinematics({"waist": 1.35})["torso"]
    with pytest.raises(UnreachableError, match=r"0.05 rad"):
        touch.inverse_kinematics("torso", beyond)


def hinge(name, parent, child, lower, upper, mimic=None):
    origin = Transform(parent, child, np.eye(3), np.array([100.0, 0.0, 0.0]))
    return Joint(name, JointType.REVOLUTE, origin, np.eye(3)[2], lower, upper, mimic)


@pytest.mark.parametrize(
    ("multiplier", "follower", "inside", "outside"),
    [
        (2.0, (-1.0, 1.0), (0.4,), (0.8,)),
        # A range of -0.2 to 1.0 at multiplier -2 leaves the leader -0.5 to 0.1.
        (-2.0, (-0.2, 1.0), (-0.49, 0.09), (-0.52, 0.12)),
    ],
)
def test_mimic_joint_stays_within_its_own_limits(multiplier, follower, inside, outside):
    lead = hinge("lead", "a", "b", -2.0, 2.0)
    follow = hinge("follow", "b", "c", *follower, Mimic("lead", multiplier, 0.0))
    finger = Robot("finger", (Link("a"), Link("b"), Link("c")), (lead, follow))
    for position in inside:
        goal = finger.forward_kinematics({"lead": position})["c"]
        assert finger.inverse_kinematics("c", goal) == pytest.approx({"lead": position})
    for position in outside:
        with pytest.raises(UnreachableError):
            finger.inverse_kinematics("c", finger.forward_kinematics({"lead": position})["c"])


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_joint_leaves_the_limit_of_its_seed(touch, end):
    """A step holds only those joints at a limit that it would move beyond it."""
    seed = {joint.name: getattr(joint, end) for joint in touch.joints if joint.moves}
    other = {joint.name: 0.5 * (joint.lower + joint.upper) for joint in touch.joints if joint.moves}
    near = {name: 0.9 * seed[name] + 0.1 * other[name] for name in seed}
    goal = touch.forward_kinematics(near)["stylus"]
    found = touch.inverse_kinematics("stylus", goal, seed=seed, options=IkOptions(restarts=0))
    assert found == pytest.approx(near, abs=1e-6)


def test_continuous_joint_stays_within_half_a_turn_of_its_seed():
    turn = Joint("turn", JointType.CONTINUOUS, Transform.identity("a", "b"), np.eye(3)[2])
    wheel = Robot("wheel", (Link("a"), Link("b")), (turn,))
    goal = wheel.forward_kinematics({"turn": 0.5})["b"]
    found = wheel.inverse_kinematics("b", goal, seed={"turn": 4.0 * math.pi})
    assert found["turn"] == pytest.approx(4.0 * math.pi + 0.5)


def test_unknown_names_are_refused(touch):
    with pytest.raises(JointError, match=r"link 'hand' is unknown"):
        touch.inverse_kinematics("hand", Transform.identity("touch_base", "hand"))
    torso = Transform.identity("touch_base", "torso")
    with pytest.raises(JointError, match="'knee' is unknown"):
        touch.inverse_kinematics("torso", torso, seed={"knee": 0.0})


@pytest.mark.parametrize(
    "bad", [{"tolerance_mm": 0.0}, {"tolerance_rad": math.nan}, {"max_iterations": 0}]
)
def test_options_out_of_range_are_refused(bad):
    with pytest.raises(JointError, match=r"expected (values above 0|at least)"):
        IkOptions(**bad)


@pytest.mark.parametrize(("name", "link"), [("touch", "stylus"), ("panda", "panda_rightfinger")])
def test_compiled_descent_agrees_with_the_uncompiled_one(request, monkeypatch, rng, name, link):
    """From starts anywhere, also with a limit in the way and with a mimic joint."""
    robot = request.getfixturevalue(name)
    moving = [joint for joint in robot.joints if joint.name in robot.actuated_joint_names]

    def anywhere():
        return {joint.name: rng.uniform(joint.lower, joint.upper) for joint in moving}

    compared = [(robot.forward_kinematics(anywhere())[link], anywhere()) for _ in range(8)]

    def solution(goal, seed):
        try:
            found = robot.inverse_kinematics(link, goal, seed=seed, options=IkOptions(restarts=3))
        except UnreachableError as error:
            return str(error)
        return list(found.values())

    compiled = [solution(*each) for each in compared]
    monkeypatch.setattr(_Problem, "minimise", _Problem.minimise_uncompiled)
    uncompiled = [solution(*each) for each in compared]
    assert sum(not isinstance(each, str) for each in compiled) >= 4
    for one, other in zip(compiled, uncompiled, strict=True):
        assert one == (other if isinstance(other, str) else pytest.approx(other, abs=1e-9))
