"""Trajectories of other planners: kept, timed anew, or refused; motions: `tests.cli`."""

import numpy as np
import pytest
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointComponentTolerance, JointTolerance
from trajectory_msgs.msg import JointTrajectoryPoint

from app.bridge.calls import ActionClient, ActionServer
from app.bridge.ros_errors import GoalAbortedError
from app.bridge.trajectory_server import read_trajectory, timed, with_start
from app.control import PlannedMotion
from app.geometry import NS_PER_S, InputError
from app.planning import MAX_DURATION_S, time_path
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

JOINTS = ("a", "b")
LIMITS = np.array([[1.0, 2.0], [5.0, 5.0], [50.0, 50.0]])
CORNER = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.8]]


def message(positions, times_s, velocities=None):
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(JOINTS)
    for k, at_s in enumerate(times_s):
        point = JointTrajectoryPoint(positions=list(positions[k]))
        if velocities is not None:
            point.velocities = list(velocities[k])
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(at_s * NS_PER_S), NS_PER_S
        )
        goal.trajectory.points.append(point)
    return goal


def motion(times_ns, positions, velocities):
    """Raises `InputError` for what the execution would not follow."""
    return PlannedMotion("r", JOINTS, {}, times_ns, positions, velocities, LIMITS[1], "setup")


def test_times_of_a_straight_motion_are_kept():
    times_ns, positions, velocities = time_path(np.array([[0.1, 0.2], [0.5, -0.7]]), LIMITS)
    slower_s = 2.0 * times_ns / NS_PER_S
    goal = read_trajectory(message(positions, slower_s, 0.5 * velocities), JOINTS)
    found = timed(goal, LIMITS)
    np.testing.assert_array_equal(found[0], 2 * times_ns)
    np.testing.assert_array_equal(found[1], positions)
    assert motion(*found).velocities[0].tolist() == [0.0, 0.0]


def test_motion_that_turns_rests_at_its_corner():
    moving = [[0.0, 0.0], [0.5, 0.5], [0.0, 0.0]]
    for velocities in (None, moving):
        goal = read_trajectory(message(CORNER, [0.0, 1.0, 2.0], velocities), JOINTS)
        found = motion(*timed(goal, LIMITS))
        (corner,) = np.flatnonzero((found.positions == CORNER[1]).all(axis=1))
        assert not found.velocities[corner].any()
        on_first, on_second = found.positions[:corner], found.positions[corner:]
        assert (on_first[:, 1] == 0.0).all() and (on_second[:, 0] == 0.4).all()
        assert found.positions[-1].tolist() == CORNER[2]
        assert (found.fastest <= LIMITS[0] + 1e-9).all()


def test_points_on_a_line_are_no_stops():
    line = np.linspace([0.0, 0.0], [0.3, 0.6], 7)
    found = timed(read_trajectory(message(line, range(7)), JOINTS), LIMITS)
    np.testing.assert_allclose(found[1], time_path(line[[0, -1]], LIMITS)[1], atol=1e-12)


def test_motion_begins_where_the_arm_stands():
    goal = read_trajectory(message([[0.3, 0.6]], [2.0], [[0.0, 0.0]]), JOINTS)
    begun = with_start(goal, np.array([0.1, 0.2]))
    assert begun.times_ns.tolist() == [0, 2 * NS_PER_S]
    assert begun.positions.tolist() == [[0.1, 0.2], [0.3, 0.6]]
    assert begun.velocities.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    at_zero = read_trajectory(message([[0.3, 0.6]], [0.0]), JOINTS)
    assert with_start(at_zero, np.array([0.1, 0.2])) is at_zero


def test_kept_times_have_a_longest_duration():
    line = [[0.0, 0.0], [0.1, 0.0]]
    for end_s in (MAX_DURATION_S, MAX_DURATION_S + 1.0):
        goal = read_trajectory(message(line, [0.0, end_s], np.zeros((2, 2))), JOINTS)
        if end_s == MAX_DURATION_S:
            assert timed(goal, LIMITS)[0][-1] == end_s * NS_PER_S
        else:
            with pytest.raises(InputError, match="takes 601 s; expected at most 600"):
                timed(goal, LIMITS)


def test_timing_ends_when_it_is_cancelled():
    zigzag = np.zeros((100, 2))
    zigzag[1::2, 0] = 1e-6
    goal = read_trajectory(message(zigzag, range(100)), JOINTS)
    answers = iter([False] * 50 + [True])
    with pytest.raises(InputError, match="path: its timing was ended"):
        timed(goal, LIMITS, lambda: next(answers))
    assert next(answers, None) is None


def test_failure_of_the_server_is_no_success(ros):
    def fail(_):
        raise ZeroDivisionError("division failed")

    ActionServer(ros, FollowJointTrajectory, "~/follow", fail)
    client = ActionClient(ros, FollowJointTrajectory, "~/follow")
    with pytest.raises(GoalAbortedError) as caught:
        client.call(FollowJointTrajectory.Goal(), DEADLINE_S)
    result = caught.value.result
    assert result.error_code == result.GOAL_TOLERANCE_VIOLATED
    assert result.error_string == "the server failed: ZeroDivisionError: division failed"


def test_faster_motion_than_the_arm_allows_is_refused():
    goal = read_trajectory(message(CORNER, [0.0, 1.0, 1.3]), JOINTS)
    with pytest.raises(
        InputError, match=r"joint 'b': moves with 2\.66667 per s; expected at most 2"
    ):
        timed(goal, LIMITS)


def test_what_cannot_be_kept_is_refused():
    def refuse(change, problem):
        goal = message(CORNER, [0.0, 1.0, 2.0])
        change(goal)
        with pytest.raises(InputError, match=problem):
            read_trajectory(goal, JOINTS)

    def points(goal):
        return goal.trajectory.points

    def tolerance(**values):
        return lambda goal: goal.path_tolerance.append(JointTolerance(name="a", **values))

    refuse(lambda goal: points(goal).clear(), "has 0 points; expected 1 to")
    refuse(lambda goal: points(goal).extend(10_000 * points(goal)[:1]), "has 10003 points; ")
    refuse(lambda goal: points(goal).reverse(), "does not increase from 0; expected increasing")
    refuse(lambda goal: points(goal).append(points(goal)[-1]), "does not increase")
    refuse(
        lambda goal: setattr(points(goal)[1], "positions", [0.0]),
        "point 1: has 1 positions; expected 2",
    )
    refuse(
        lambda goal: setattr(points(goal)[2], "velocities", [0.0, 0.0]),
        "point 0: has 0 velocities; expected 2",
    )
    refuse(
        lambda goal: setattr(points(goal)[1], "positions", [0.0, float("nan")]), "are not finite"
    )
    refuse(lambda goal: setattr(points(goal)[1], "effort", [1.0, 1.0]), "effort: is given")
    refuse(lambda goal: setattr(goal.trajectory.header.stamp, "sec", 5), "header.stamp: is not 0")
    refuse(
        lambda goal: setattr(goal.goal_time_tolerance, "sec", 1), "tolerance: is 1 s; expected 0"
    )
    refuse(lambda goal: goal.multi_dof_trajectory.joint_names.append("base"), "expected none")
    refuse(
        lambda goal: goal.component_goal_tolerance.append(JointComponentTolerance()),
        "component tolerances: are given; expected none",
    )
    refuse(tolerance(position=0.001), "tolerance of joint 'a': is given; expected none, or")
    refuse(tolerance(velocity=1.0), "tolerance of joint 'a'")
    kept = message(CORNER, [0.0, 1.0, 2.0])
    tolerance(position=0.02)(kept)
    assert read_trajectory(kept, JOINTS).positions.tolist() == CORNER
