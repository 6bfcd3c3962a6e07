"""Markers of plans, and requests that the planning node refuses; plans: `tests.cli`."""

import threading
import time
from functools import partial

import numpy as np
import pytest
import trimesh
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import NeedleCorridors
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from app.bridge import RosNode, guard_scene, plan_execution, planning_server
from app.bridge.calls import ActionClient
from app.bridge.calls.service_client import ServiceClient
from app.bridge.guard_scene import PathWatch
from app.bridge.messages import header_message
from app.bridge.obstacles import Obstacles
from app.bridge.planning_server import corridor_markers, way_markers
from app.bridge.ros_errors import BridgeError, GoalAbortedError
from app.bridge.topics import NEWEST, STREAM, Topic
from app.control import open_control, read_plan
from app.geometry import Stamp, SurfaceMesh, Transform
from app.planning import EntryRegion, ForbiddenStructure, Needle, NeedleTarget, plan_needle
from tests.bridge.nodes import ros_nodes
from tests.planning.plan_files import write_approach
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


def test_way_is_shown_in_the_frame_of_the_tracker():
    tracker_from_root = Transform(
        "tracker", "root", np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [5, 0, 0]
    )
    tips_mm = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 20.0, 0.0]])
    before, way, end = way_markers(tracker_from_root, tips_mm).markers
    assert before.action == Marker.DELETEALL
    shown = [(each.x, each.y, each.z) for each in way.points]
    assert np.array(shown) == pytest.approx(
        np.array([[0.005, 0.0, 0.0], [0.005, 0.01, 0.0], [-0.015, 0.01, 0.0]])
    )
    assert (way.header.frame_id, end.points) == ("tracker", way.points[-1:])


def test_entries_are_shown_by_their_score_and_blocked_ones_red():
    shape = trimesh.creation.icosphere(2, 5.0)
    vessel = SurfaceMesh("ct", shape.vertices + np.array([0.0, 0.0, 30.0]), shape.faces)
    plan = plan_needle(
        EntryRegion.of_disc("ct", [0, 0, 60], [0, 0, 1], 40.0, count=200),
        NeedleTarget.of_points("ct", [[0, 0, 0]]),
        Needle(100.0, 1.2, 1.0),
        [ForbiddenStructure("vessel", vessel, 2.0, 0.5)],
        error=1.0,
        k_sigma=2.0,
    )
    _, entries, corridors = corridor_markers(plan).markers
    shown = np.array([[each.x, each.y, each.z] for each in entries.points])
    assert shown == pytest.approx(plan.region.points_mm / 1000.0)
    is_red = np.array([each.r > each.g and each.a < 1.0 for each in entries.colors])
    assert 0 < is_red.sum() < 200
    assert (is_red == np.isnan(plan.scores)).all()
    best = int(np.nanargmax(plan.scores))
    assert entries.colors[best].r == min(each.r for each in entries.colors if each.a == 1.0)
    ends = np.array([[each.x, each.y, each.z] for each in corridors.points[:2]])
    assert ends == pytest.approx(np.array([shown[best], [0.0, 0.0, 0.0]]))


def test_requests_that_cannot_be_served_are_refused(domain_id, project_root, monkeypatch):
    for module in (plan_execution, guard_scene):
        monkeypatch.setattr(module, "WAIT_S", 0.5)
    monkeypatch.setattr(plan_execution, "END_S", 0.1)
    description, lock = (
        open_control(project_root / "data" / "worlds" / "lumpectomy"),
        threading.Lock(),
    )
    with ros_nodes(domain_id, planning_server.NODE_NAME, "peer") as (ros, peer):
        arm = plan_execution.ExecutionNode(ros, description, clock_ns=time.time_ns)
        guard = guard_scene.GuardScene(ros, description, Obstacles(ros))
        plan_execution.ExecutionServer(ros, arm, lock, partial(PathWatch, description, guard))
        planning_server.PlanningServer(ros, description, arm, guard, lock)
        plans = ActionClient(peer, "marginguard_msgs/action/Plan", "/marginguard_plan/plan")
        name = "/marginguard_plan/needle_corridors"
        corridors = ServiceClient(peer, NeedleCorridors, name)
        request = NeedleCorridors.Request(entry_radius=0.01, length=0.1, diameter=0.001)
        request.entry.header.frame_id, request.entry.pose.orientation.w = "tracker", 1.0
        with pytest.raises(GoalAbortedError, match="allowed_time: is nan s; expected a number"):
            plans.call({"allowed_time": float("nan")}, DEADLINE_S)
        goal, busy = (
            {"allowed_time": 1.0},
            "another request is being served; expected one after the other",
        )
        with lock:
            with pytest.raises(GoalAbortedError, match=busy):
                plans.call(goal, DEADLINE_S)
            assert corridors.call(request, DEADLINE_S).message == busy
            monkeypatch.setattr(plan_execution, "END_S", DEADLINE_S)
            waiting = plans.start(goal, DEADLINE_S)
        with pytest.raises(GoalAbortedError, match="joints of /arm: no usable positions; expected"):
            waiting.result(DEADLINE_S)
        without = corridors.call(request, DEADLINE_S)
    assert without.message == "guard /marginguard: no step in 0.5 s; expected a running one"


def test_cancel_after_the_acceptance_of_a_goal_is_not_lost(
    domain_id, project_root, monkeypatch, tmp_path
):
    monkeypatch.setattr(plan_execution, "WAIT_S", 0.5)
    monkeypatch.setattr(plan_execution, "END_S", DEADLINE_S)
    description = open_control(project_root / "data" / "worlds" / "lumpectomy")
    lock = threading.Lock()
    plan = write_approach(tmp_path / "plan.json", description.tool.robot, "setup").read_text()
    with ros_nodes(domain_id, planning_server.NODE_NAME, "peer") as (ros, peer):
        node = plan_execution.ExecutionNode(ros, description, clock_ns=time.time_ns)
        guard = guard_scene.GuardScene(ros, description, Obstacles(ros))
        plan_execution.ExecutionServer(ros, node, lock, partial(PathWatch, description, guard))
        name = "marginguard_msgs/action/Execute"
        executions = ActionClient(peer, name, "/marginguard_plan/execute")
        cancel = ServiceClient(peer, Trigger, "/marginguard_plan/cancel")
        with lock:
            sent = executions.start({"plan": plan}, DEADLINE_S)
            assert cancel.call(Trigger.Request(), DEADLINE_S).success
        with pytest.raises(GoalAbortedError, match="cancelled before it began"):
            sent.result(DEADLINE_S)


def test_guard_that_ended_before_the_plan_came_does_not_forbid_its_motion(
    domain_id, project_root, monkeypatch, tmp_path
):
    monkeypatch.setattr(plan_execution, "WAIT_S", 1.0)
    description = open_control(project_root / "data" / "worlds" / "lumpectomy")
    plan = read_plan(write_approach(tmp_path / "plan.json", description.tool.robot, "setup"))
    now_ns = time.time_ns()
    with ros_nodes(domain_id, "executor", "peer") as (ros, peer):
        node = plan_execution.ExecutionNode(ros, description, clock_ns=lambda: now_ns)
        received = []
        topic = Topic(description.constraint_topic, FixtureConstraint, NEWEST)
        ros.subscribe(topic, received.append)
        for instance_id in ("before", "now"):
            with RosNode(instance_id, domain_id=domain_id) as guard:
                constraints = guard.publisher(topic)
                wait_until(lambda each=constraints: each.get_subscription_count() == 2)
                constraints.publish(FixtureConstraint(instance_id=instance_id, setup_id="setup"))
                wait_until(lambda each=instance_id: received and received[-1].instance_id == each)
        joints = peer.publisher(Topic("/arm/measured_js", JointState, STREAM))
        names = list(description.tool.joints)
        state = JointState(header=header_message("", Stamp(now_ns)), name=names)
        state.position = [0.0] * len(names)
        peer.every(0.02, lambda: joints.publish(state))
        with pytest.raises(BridgeError, match="constraint: no_message; expected one that allows"):
            node.run(plan, lambda step: None)
