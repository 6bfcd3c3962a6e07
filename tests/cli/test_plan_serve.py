"""Plans of a node beside a running guard: where the tumour truly is, and executed as they are."""

import json
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from marginguard_msgs.srv import NeedleCorridors
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.calls import ActionClient
from app.bridge.calls.service_client import ServiceClient
from app.bridge.ros_errors import GoalAbortedError, GoalCancelledError
from app.bridge.tf_topics import tf_message
from app.bridge.topics import LATCHED, STREAM, TF, Topic
from app.geometry import Stamp, Transform
from app.workflow.needle_guide import read_needle_plan
from tests.bridge.live.conftest import DEADLINE_S
from tests.cli.test_page_push import world as world
from tests.cli.test_plan_execute import FOLLOW_RAD, MAX_PLANS
from tests.cli.test_plan_execute import cell as cell

pytestmark = pytest.mark.long

TRACKER_MM = 3.0
"""Errors of the simulated tracker."""

TUMOR_MM = np.array([205.0, 0.0, 80.0])
"""Its place in the world, which is the tracker's frame and that of the arm's base."""


class Planner:
    """The node's clients, and the markers that it has sent."""

    def __init__(self, cell):
        self.cell, self.ros, self.markers = cell, cell.judge.ros, []
        self.server, self.obstacles = cell.serve(), None
        topic = Topic("/marginguard_plan/markers", MarkerArray, LATCHED)
        self.ros.subscribe(topic, self.markers.append)
        self.plans, self.executions = (
            ActionClient(self.ros, f"marginguard_msgs/action/{kind}", f"/marginguard_plan/{name}")
            for kind, name in (("Plan", "plan"), ("Execute", "execute"))
        )

    def plan(self, clearance_mm=3.0, **goal):
        goal |= {"clearance": clearance_mm, "allowed_time": 20.0}  # plain values are in mm
        return self.plans.call(goal, DEADLINE_S)

    def place(self, number, center_mm, radius_mm, frame, *, is_locked=False):
        """Report a ball as an obstacle; returns its marker."""
        ball = Marker(ns="ball", id=number, type=Marker.SPHERE, action=Marker.ADD)
        ball.frame_locked = is_locked
        ball.header.frame_id = frame
        place, turn = ball.pose.position, ball.pose.orientation
        place.x, place.y, place.z = (np.asarray(center_mm) / 1000.0).tolist()
        turn.w = 1.0
        ball.scale.x = ball.scale.y = ball.scale.z = 0.002 * radius_mm
        self.report(ball)
        return ball

    def report(self, *markers):
        if self.obstacles is None:
            topic = Topic("/marginguard_plan/obstacles", MarkerArray, STREAM)
            self.obstacles = self.ros.publisher(topic)
            self.cell.wait(lambda: self.obstacles.get_subscription_count() == 1)
        self.obstacles.publish(MarkerArray(markers=list(markers)))

    def shown(self):
        """The last markers without the one that deletes those before."""
        self.cell.wait(lambda: self.markers)
        return self.markers[-1].markers[1:]


@pytest.fixture
def planner(cell):
    return Planner(cell)


def pose(point_mm, turn, frame):
    place = dict(zip("xyz", np.asarray(point_mm).tolist(), strict=True))
    orientation = dict(zip("xyzw", np.asarray(turn).tolist(), strict=True))
    return {"header": {"frame_id": frame}, "pose": {"position": place, "orientation": orientation}}


def test_approach_is_planned_and_executed(cell, planner):
    goal = {"joints": ["waist"], "positions": [0.3]}
    made = planner.plan(**goal)
    assert (made.success, made.message, made.registration_id) == (True, "", "")
    assert made.setup_id == json.loads(made.plan)["made_from"]["setup_id"] != ""
    assert made.trajectory.header.frame_id == cell.robot.root_link
    assert made.trajectory.joint_names == ["waist"]
    assert made.trajectory.points[-1].positions.tolist() == [0.3]
    way, _ = planner.shown()
    assert (way.ns, way.header.frame_id) == ("planned_way", "tracker")
    assert len(way.points) == len(made.trajectory.points)
    arrived = cell.run_goals(
        planner.executions,
        {"waist": 0.3},
        cancel=False,
        plan=lambda _: json.loads(planner.plan(**goal).plan),
    )
    assert (arrived.success, arrived.outcome) == (True, "arrived")
    waist = cell.judge.measured()[-1][cell.joints.index("waist")]
    assert waist == pytest.approx(0.3, abs=FOLLOW_RAD)
    assert planner.server.end(signal.SIGINT) == 130


def test_tool_keeps_from_the_tumour_where_it_truly_is(cell, planner):
    at = dict(zip(cell.joints, cell.judge.measured()[-1].tolist(), strict=True))
    tip = cell.robot.forward_kinematics(at)["stylus"]
    above = tip.apply([[0.0, 0.0, 70.0]])[0] + [0.0, 10.0, 0.0]
    made = planner.plan(tip=pose(above, tip.quaternion_xyzw, "tracker"))
    end = dict(zip(made.trajectory.joint_names, made.trajectory.points[-1].positions, strict=True))
    reached = cell.robot.forward_kinematics({**at, **end})["stylus"]
    assert reached.apply([[0.0, 0.0, 70.0]])[0] == pytest.approx(above, abs=1e-3)
    distance_mm = cell.judge.distances_mm()[-1]
    with pytest.raises(GoalAbortedError, match="start: tool is") as refused:
        planner.plan(distance_mm + TRACKER_MM, joints=["waist"], positions=[0.3])
    found_mm = re.search(r"is ([\d.]+) mm from tumor; expected", str(refused.value))
    assert float(found_mm[1]) == pytest.approx(distance_mm, abs=TRACKER_MM)
    with pytest.raises(GoalAbortedError, match=r"goal: .* is 0\.00 mm from tumor"):
        planner.plan(tip=pose(TUMOR_MM, tip.quaternion_xyzw, cell.robot.root_link))


def test_corridors_end_in_the_tumour_where_it_truly_is(cell, planner, project_root, tmp_path):
    client = ServiceClient(cell.judge.ros, NeedleCorridors, "/marginguard_plan/needle_corridors")
    request = NeedleCorridors.Request(
        entry_radius=0.02, length=0.1, diameter=0.0012, bend=0.001, sigma=0.001
    )
    assert "entry: has no frame_id" in client.call(request, DEADLINE_S).message
    skin = TUMOR_MM + np.array([0.0, 0.0, 40.0])
    request.entry.header.frame_id = "tracker"
    place, turn = request.entry.pose.position, request.entry.pose.orientation
    place.x, place.y, place.z = (skin / 1000.0).tolist()
    turn.w = 1.0
    reply = client.call(request, DEADLINE_S)
    assert (reply.success, reply.message) == (True, "")
    assert json.loads(reply.plan)["setup_id"] == reply.setup_id != ""
    assert len(reply.entries) == len(reply.targets) == len(reply.scores) > 0
    (tmp_path / "plan.json").write_text(reply.plan)
    shown = read_needle_plan(tmp_path / "plan.json")  # as page and panel do
    assert len(shown.paths) == len(reply.entries)
    tumor = trimesh.load_mesh(project_root / "data" / "recorded_case" / "tumor.stl")
    target_mm = 1000.0 * np.array([[each.x, each.y, each.z] for each in reply.targets[:1]])
    assert tumor.contains(target_mm - TUMOR_MM).all()
    entry = reply.entries[0]
    assert entry.z == pytest.approx(skin[2] / 1000.0)
    planner.place(0, skin, 25.0, "tracker")  # over the whole disc
    blocked = client.call(request, DEADLINE_S)
    while blocked.success:  # the obstacle has not arrived yet
        blocked = client.call(request, DEADLINE_S)
    assert "obstacle ball/0 blocks 10000" in blocked.message
    entries, corridors = planner.shown()
    assert (len(entries.points), len(entries.colors)) == (10_000, 10_000)
    assert len(corridors.points) == 2 * len(reply.entries)


def test_cancelled_goal_ends(cell, planner):
    goal = {"joints": ["waist"], "positions": [0.3], "clearance": 3.0, "allowed_time": 1e6}
    with pytest.raises(GoalAbortedError, match="expected a number above 0"):
        planner.plans.call({**goal, "clearance": 0.0}, DEADLINE_S)
    sent = planner.plans.start(goal, DEADLINE_S)
    sent.cancel()
    try:
        assert sent.result(DEADLINE_S).success  # found before
    except GoalCancelledError as error:
        assert error.result.message == "cancelled"


@pytest.fixture
def trajectories(planner, start):
    """Goals of a process with plain rclpy: ``send(joints, points, cancel)`` returns the result."""
    client = start(Path(__file__).with_name("trajectory_client.py"))
    client.line(lambda line: line == "ready\n")

    def send(joints, points, cancel=None):
        client.send(json.dumps({"joints": joints, "points": points, "cancel": cancel}))
        return json.loads(client.line(lambda line: line.startswith("{")))

    return send


def test_trajectory_of_another_planner_is_executed(cell, planner, trajectories):
    """Two lines of two joints, in motion at the corner, as of a planner that blends."""
    names = ["elbow", "waist"]
    for _ in range(MAX_PLANS):
        cell.wait(cell.judge.is_ready)
        at = dict(zip(cell.joints, cell.judge.measured()[-1].tolist(), strict=True))
        begin = np.array([at[name] for name in names])
        corners = begin + np.array([[0.0, 0.0], [0.0, 0.2], [0.1, 0.2]])
        moving = [[0.0, 0.0], [0.1, 0.1], [0.0, 0.0]]
        points = [[2.0 * k, corner.tolist(), moving[k]] for k, corner in enumerate(corners)]
        since = len(cell.judge.received)
        found = trajectories(names, points)
        columns = [cell.joints.index(name) for name in names]
        measured = cell.judge.measured(since)[:, columns] - begin
        along_first = np.clip(measured[:, 1], 0.0, 0.2)[:, None] * [0.0, 1.0]
        along_second = np.clip(measured[:, 0], 0.0, 0.1)[:, None] * [1.0, 0.0] + [0.0, 0.2]
        away = [np.abs(measured - each).max(axis=1) for each in (along_first, along_second)]
        assert np.minimum(*away).max() < FOLLOW_RAD
        if found["code"] == FollowJointTrajectory.Result.SUCCESSFUL:
            break
        assert found["status"] == GoalStatus.STATUS_ABORTED
        assert "expected" in found["text"]  # late data: planned again
    assert found["status"] == GoalStatus.STATUS_SUCCEEDED
    assert measured[-1] == pytest.approx([0.1, 0.2], abs=FOLLOW_RAD)
    assert len(found["feedback"]) > 3
    for _, joints, desired, actual, error in found["feedback"]:
        assert joints == names
        assert np.subtract(desired, actual) == pytest.approx(error)
        assert np.abs(error).max() < FOLLOW_RAD
    seconds = [each[0] for each in found["feedback"]]
    assert seconds == sorted(seconds)


def test_trajectory_that_may_not_begin_is_refused_and_a_cancelled_one_stops(
    cell, planner, trajectories
):
    result = FollowJointTrajectory.Result
    cell.wait(cell.judge.is_ready)
    at = dict(zip(cell.joints, cell.judge.measured()[-1].tolist(), strict=True))
    before = cell.judge.measured()[-1]
    waist = at["waist"]
    found = trajectories(["knee"], [[1.0, [0.0], []]])
    assert (found["status"], found["code"]) == (GoalStatus.STATUS_ABORTED, result.INVALID_JOINTS)
    assert found["text"].startswith("joint_names: are knee; expected some of waist, shoulder")
    found = trajectories(["waist"], [[0.01, [waist + 0.5], []]])
    assert found["code"] == result.INVALID_GOAL
    assert "joint 'waist': moves with 50 per s; expected at most" in found["text"]
    away = waist + 0.1
    found = trajectories(["waist"], [[0.0, [away], []], [2.0, [away + 0.1], []]])
    assert f"joint 'waist': is at {waist:.3f}"[:-1] in found["text"]
    into = cell.lowered()
    found = trajectories([*into], [[4.0, [*into.values()], []]])
    assert re.match(r"path: after \d+ of \d+ parts tool is not proven to keep", found["text"])
    assert "from tumor; expected 5 mm from structures" in found["text"]
    turns = [[0.1 * k, [waist + 1e-6 * (k % 2)], []] for k in range(9000)]
    found = trajectories(["waist"], turns, -1.0)
    assert (found["status"], found["code"], found["text"]) == (
        GoalStatus.STATUS_CANCELED,
        result.GOAL_TOLERANCE_VIOLATED,
        "cancelled before it began",
    )
    assert cell.judge.plans == []
    assert np.abs(cell.judge.measured()[-1] - before).max() < FOLLOW_RAD
    for _ in range(MAX_PLANS):
        cell.wait(cell.judge.is_ready)
        begin = float(cell.judge.measured()[-1][cell.joints.index("waist")])
        found = trajectories(["waist"], [[5.0, [begin + 0.6], []]], 0.2)
        if found["status"] == GoalStatus.STATUS_CANCELED:
            break
        assert found["status"] == GoalStatus.STATUS_ABORTED  # late data
    assert "cancelled by an operator" in found["text"]
    assert cell.judge.measured()[-1][cell.joints.index("waist")] < begin + 0.5


BALL_MM = 10.0


def tips_mm(cell, measured):
    """The tool's tip in the root link, (k, 3)."""
    poses = [
        cell.robot.forward_kinematics(dict(zip(cell.joints, each.tolist(), strict=True)))
        for each in measured
    ]
    return np.array([pose["stylus"].apply([[0.0, 0.0, 70.0]])[0] for pose in poses])


def turned(cell, planner, act, expected, prepare=lambda: None):
    """Turn the waist, and ``act(waist)`` in mid-motion; the result, and the joints on the way.

    ``waist`` is its angle near the end. Planned again, after ``prepare()``, while late data have
    stopped the arm.
    """
    for _ in range(MAX_PLANS):
        planner.report(Marker(action=Marker.DELETEALL))
        prepare()
        begin = float(cell.judge.measured()[-1][cell.joints.index("waist")])
        turn = 0.6 if begin < 0.6 else -0.6
        plan = cell.plan({"waist": begin + turn})
        cell.wait(cell.judge.is_ready)
        since = len(cell.judge.received)
        sent = planner.executions.start({"plan": json.dumps(plan)}, DEADLINE_S)
        cell._wait_until_moving(plan, sent)
        act(begin + turn / 1.2)
        cell._wait_until_ended(sent)
        try:
            result = sent.result(DEADLINE_S)
        except GoalAbortedError as error:
            result = error.result
        if result.outcome == expected:
            return result, cell.judge.measured(since)
        assert result.outcome in ("", "rule", "no_joints", "no_pose", "off_path"), result.message
    return pytest.fail(f"not within {MAX_PLANS} plans: {result.message}")


def ahead_mm(cell, waist):
    """Place of the tool's tip in the root link when the waist is at ``waist``."""
    at = dict(zip(cell.joints, cell.judge.measured()[-1].tolist(), strict=True))
    return tips_mm(cell, [np.array([{**at, "waist": waist}[name] for name in cell.joints])])[0]


def test_obstacle_in_the_way_stops_a_motion_and_is_avoided(cell, planner):
    def place(waist):
        found.append((ahead_mm(cell, waist), waist))
        planner.place(0, found[-1][0], BALL_MM, cell.robot.root_link)

    found = []
    result, measured = turned(cell, planner, place, "obstacle")
    assert "is not proven to keep its clearance from obstacle ball/0" in result.message
    center_mm, waist = found[-1]
    distances_mm = np.linalg.norm(tips_mm(cell, measured) - center_mm, axis=1)
    assert distances_mm.min() > BALL_MM
    with pytest.raises(GoalAbortedError, match=r"goal: .* mm from obstacle ball/0; expected"):
        planner.plan(joints=["waist"], positions=[waist])
    planner.place(1, [0.0, 0.0, 900.0], BALL_MM, "nowhere")
    with pytest.raises(GoalAbortedError, match=r"obstacle 'ball/1': 'nowhere' is not connected"):
        planner.plan(joints=["waist"], positions=[0.0])
    planner.report(Marker(ns="ball", id=1, action=Marker.DELETE))
    assert planner.plan(joints=["waist"], positions=[0.0]).success


def test_motion_goes_on_past_an_obstacle_that_is_not_in_its_way(cell, planner):
    def place(_):
        planner.place(0, [0.0, 0.0, 900.0], BALL_MM, cell.robot.root_link)

    result, _ = turned(cell, planner, place, "arrived")
    assert result.success


class Stand:
    """Frame that tf places at ``at_mm`` in the root link, and not while it is None.

    Another one, "shelf", does not move.
    """

    def __init__(self, cell):
        self.at_mm = None
        self._ros, self._frames = cell.judge.ros, cell.judge.ros.publisher(TF)
        self._ros.every(0.02, self._publish)

    def _publish(self):
        places = {"shelf": [0.0, 0.0, 950.0], "stand": self.at_mm}
        for name, at_mm in places.items():
            if at_mm is not None:  # the root link is where the tracker's frame is
                pose = Transform("tracker", name, np.eye(3), at_mm)
                self._frames.publish(tf_message([(pose, Stamp(time.time_ns()))]))


def test_obstacle_that_moves_with_its_frame_stops_a_motion(cell, planner):
    stand, far_mm, found = Stand(cell), [0.0, 0.0, 900.0], []

    def prepare():
        stand.at_mm = far_mm
        for number in range(1, 17):  # as many as one period looks at
            planner.place(number, [0.0, 0.0, 0.0], 5.0, "shelf", is_locked=True)
        planner.place(0, [0.0, 0.0, 0.0], BALL_MM, "stand", is_locked=True)

    def approach(waist):
        found.append(ahead_mm(cell, waist))
        stand.at_mm = found[-1]

    def fall_silent(_):
        stand.at_mm = None

    def pass_by(_):
        stand.at_mm = [0.0, 0.0, 905.0]

    result, measured = turned(cell, planner, approach, "obstacle", prepare)
    assert "is not proven to keep its clearance from obstacle ball/0" in result.message
    distances_mm = np.linalg.norm(tips_mm(cell, measured) - found[-1], axis=1)
    assert distances_mm.min() > BALL_MM
    result, _ = turned(cell, planner, fall_silent, "obstacle", prepare)
    is_old = r"obstacle 'ball/0': frame 'stand' is \d+ ms old in tf; expected 0 to 200 ms"
    assert re.fullmatch(is_old, result.message)
    assert result.progress < 1.0
    with pytest.raises(GoalAbortedError, match=is_old):
        planner.plan(joints=["waist"], positions=[0.0])
    with pytest.raises(GoalAbortedError, match=is_old):
        plan = json.dumps(cell.plan({"waist": 0.0}))
        planner.executions.call({"plan": plan}, DEADLINE_S)
    stand.at_mm = far_mm
    assert planner.plan(joints=["waist"], positions=[0.0]).success
    result, _ = turned(cell, planner, pass_by, "arrived", prepare)
    assert result.success
