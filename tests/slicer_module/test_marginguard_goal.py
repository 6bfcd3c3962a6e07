"""A goal by the panel's handles beside a running ``marginguard plan serve``."""

import numpy as np
import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge import RosNode
from app.bridge.topics import LATCHED, STREAM, Topic
from app.robot import Robot
from app.scene.convert import world_matrix
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.bridge.live.test_live_command import SENDER, TRACKED
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import node_of, spin_until
from tests.slicer_module.test_marginguard_plans import STYLUS, place_handle
from tests.viewer.test_plan_page import planner as planner
from tests.waiting import wait_until

pytestmark = pytest.mark.long

SHIFT_MM = (0.0, 40.0, 40.0)
"""Aside and up, away from the tumour."""


def wall(robot: Robot, at: dict[str, float], waist: float) -> Marker:
    """A wall that stands from the base outwards, in the direction of the arm at ``waist``."""
    x, y, _ = robot.forward_kinematics({**at, "waist": waist})["stylus"].translation_mm
    turn = 0.5 * np.arctan2(y, x)
    made = Marker(ns="wall", type=Marker.CUBE, action=Marker.ADD)
    made.header.frame_id = robot.root_link
    made.pose.position.x, made.pose.position.y = 0.6 * np.cos(2.0 * turn), 0.6 * np.sin(2.0 * turn)
    made.pose.orientation.z, made.pose.orientation.w = np.sin(turn), np.cos(turn)
    made.scale.x, made.scale.y, made.scale.z = 1.0, 0.002, 2.0
    return made


@pytest.fixture
def judge(unconnected, domain_id):
    """A node that sees the states of the planner's goals, and reports obstacles to it."""
    with RosNode("judge", domain_id=domain_id) as ros:
        yield ros


def test_plan_to_the_handle_is_made_by_another_process_and_drawn(
    unconnected, application, judge, planner, start, frames_file, live_yaml
):
    panel, goal, states = unconnected, unconnected.plans.goal, []
    judge.subscribe(
        Topic("/marginguard_plan/plan/_action/status", GoalStatusArray, LATCHED),
        lambda now: states.append([each.status for each in now.status_list]),
    )
    obstacles = judge.publisher(Topic("/marginguard_plan/obstacles", MarkerArray, STREAM))
    wait_until(lambda: obstacles.get_subscription_count() == 1)
    panel.connect(live_yaml(TRACKED))
    start(str(SENDER), str(frames_file), "tracked", "again")

    def has_begun(now):  # as soon as the joints are known
        if now.plans.goal is not None and not now.plans.goal.is_active:
            goal.begin(1.0)
        return node_of(application, "ToolGoal") is not None

    spin_until(panel, has_begun)
    handle = node_of(application, "ToolGoal")
    place_handle(handle, SHIFT_MM)
    spin_until(panel, lambda now: now.plans.goal.can_plan)
    robot = panel.session.started().content.robot.robot
    between = 0.5 * (planner["waist"] + goal._reached["waist"])
    obstacles.publish(MarkerArray(markers=[wall(robot, planner, between)]))

    goal.plan()
    spin_until(panel, lambda now: states and states[-1] == [GoalStatus.STATUS_EXECUTING])
    assert panel.refresh().plans.goal.status == "planning..."
    place_handle(handle, (0.0, 0.0, 1.0))
    shown = panel.refresh().plans.goal
    assert (shown.can_plan, shown.status) == (True, "cancelled: the goal has moved; plan again")
    spin_until(panel, lambda now: states[-1] == [GoalStatus.STATUS_CANCELED])

    obstacles.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    place = world_matrix(handle)
    goal.plan()
    shown = spin_until(panel, lambda now: now.plans.goal.status != "planning...").plans.goal
    assert (shown.status, shown.is_active) == ("planned; nothing has moved", False)
    shown = spin_until(panel, lambda now: now.plans.approach).plans.approach
    assert (shown.problem, node_of(application, "ToolGoal")) == ("", None)
    ghost = node_of(application, STYLUS).GetParentTransformNode()
    np.testing.assert_allclose(world_matrix(ghost), place, atol=1e-3)
    panel.plans.ghost.go_to(0)
    panel.refresh()
    assert not np.allclose(world_matrix(ghost), place, atol=1.0)
