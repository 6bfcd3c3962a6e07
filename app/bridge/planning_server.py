"""Serves plans for an arm beside a running guard; `app.bridge.plan_execution` executes them.

====================== =============================== ============================================
``~/plan``             marginguard_msgs/Plan           an approach of the arm; nothing moves
``~/needle_corridors`` marginguard_msgs/NeedleCorridors  corridors past forbidden structures
``~/markers``          visualization_msgs/MarkerArray  the planned way, or entries and corridors
====================== =============================== ============================================

Surfaces, their poses and the registration are those of the guard.
"""

import json
import math
import threading
import time
from collections.abc import Iterable, Mapping

import numpy as np
from geometry_msgs.msg import PoseStamped
from marginguard_msgs.action import Plan
from marginguard_msgs.srv import NeedleCorridors
from std_msgs.msg import ColorRGBA
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge import topics
from app.bridge.calls.action_server import ActionServer, GoalOutcome, ServedGoal
from app.bridge.calls.service_server import ServiceServer
from app.bridge.guard_scene import GuardScene, Scene, ids_of, poses_of
from app.bridge.messages import MM_PER_M, color_message, header_message, point_message, pose_of
from app.bridge.node import RosNode
from app.bridge.plan_execution import ExecutionNode, alone
from app.bridge.publishing.markers import marker_message
from app.control import ControlDescription
from app.geometry import (
    NS_PER_S,
    FloatArray,
    InputError,
    Stamp,
    Transform,
)
from app.planning import (
    Approach,
    ApproachError,
    EntryRegion,
    MotionLimits,
    Needle,
    NeedlePlan,
    plan_approach,
)
from app.runtime import SessionContent
from app.session import StepResult
from app.workflow import plan_corridors

NODE_NAME = "marginguard_plan"

ENTRIES = 10_000
"""Candidates of an entry: each is a point in RViz."""

_FEEDBACK_S = 0.5
_TIP = "tip"


class PlanningServer:
    """Serves plans for the arm of ``description`` until ``ros`` closes.

    ``arm`` measures and moves it, ``guard`` has the scene. One request at a time is served, with
    ``lock`` held: a plan begins where the arm stands, and its search would delay a motion.
    """

    def __init__(
        self,
        ros: RosNode,
        description: ControlDescription,
        arm: ExecutionNode,
        guard: GuardScene,
        lock: threading.Lock,
    ) -> None:
        self._about, self._arm, self._guard, self._lock = description, arm, guard, lock
        self._tool, self._robot = description.tool, description.tool.robot
        self._markers = ros.publisher(topics.MARKERS)
        ActionServer(ros, Plan, "~/plan", self._plan)
        ServiceServer(
            ros, NeedleCorridors, "~/needle_corridors", self._find_corridors, in_thread=True
        )

    def _plan(self, served: ServedGoal) -> tuple[Plan.Result, GoalOutcome]:
        request, begin_s = served.request, time.monotonic()
        reported_s = begin_s
        if not 0.0 < request.allowed_time < math.inf:
            raise InputError(
                f"allowed_time: is {request.allowed_time:g} s; expected a number above 0"
            )

        def is_over() -> bool:
            nonlocal reported_s
            now_s = time.monotonic()
            if now_s - reported_s >= _FEEDBACK_S:
                reported_s = now_s
                served.feedback(Plan.Feedback(elapsed=now_s - begin_s))
            return served.cancelled.is_set() or now_s - begin_s > request.allowed_time

        with alone(self._lock):
            start = self._arm.positions()
            scene, goal = self._guard.read(
                lambda content, step: self._scene(content, step, request)
            )
            try:
                approach = plan_approach(
                    self._robot,
                    start,
                    goal,
                    scene.structures,
                    clearance_mm=MM_PER_M * request.clearance,
                    limits={
                        name: MotionLimits(*each) for name, each in self._about.joint_limits.items()
                    },
                    carried=scene.carried,
                    is_over=is_over,
                    made_from=scene.ids,
                )
            except ApproachError:
                if served.cancelled.is_set():
                    return Plan.Result(message="cancelled"), GoalOutcome.CANCELLED
                raise
        if served.cancelled.is_set():
            return Plan.Result(message="cancelled"), GoalOutcome.CANCELLED
        self._markers.publish(way_markers(scene.frame_from_root, self._tips_mm(approach)))
        result = Plan.Result(
            success=True,
            trajectory=self._trajectory(approach),
            plan=json.dumps(approach.as_document(self._robot.name), allow_nan=False),
            **scene.ids,
        )
        return result, GoalOutcome.SUCCEEDED

    def _scene(
        self, content: SessionContent, step: StepResult, request: Plan.Goal
    ) -> tuple[Scene, Mapping[str, float] | Transform]:
        """The scene and the goal. Raises `FrameError` while a pose is not known."""
        scene, obstacles = self._guard.scene_with_obstacles(content, step)
        scene = scene._replace(structures={**scene.structures, **obstacles})
        if request.joints or request.positions:
            goal = dict(zip(request.joints, request.positions, strict=False))
            if not len(goal) == len(request.joints) == len(request.positions):
                raise InputError(
                    f"goal: has {len(request.joints)} joints, {len(goal)} of them once and with a "
                    f"position, and {len(request.positions)} positions; expected one for each joint"
                )
            return scene, goal
        tip = _pose(request.tip, "tip", _TIP)
        if tip.target != self._robot.root_link:
            frame_from_root = scene.frame_from_root
            between = step.edges.between(frame_from_root.target, tip.target)[0]
            tip = frame_from_root.inverse() @ between @ tip
        return scene, tip @ self._tool.link_from_tip.renamed(source=_TIP).inverse()

    def _tips_mm(self, approach: Approach) -> FloatArray:
        """Places (n, 3) of the tool's tip in the root link."""
        joints = self._tool.joints
        states = np.array([[approach.held.get(name, 0.0) for name in joints]])
        states = states.repeat(len(approach.positions), axis=0)
        states[:, [joints.index(name) for name in approach.joints]] = approach.positions
        return np.array([self._tool.evaluate(state)[0].translation_mm for state in states])

    def _trajectory(self, approach: Approach) -> JointTrajectory:
        made = JointTrajectory(
            header=header_message(self._robot.root_link, Stamp(0)),
            joint_names=list(approach.joints),
        )
        for time_ns, positions, velocities in zip(
            approach.times_ns.tolist(),
            approach.positions.tolist(),
            approach.velocities.tolist(),
            strict=True,
        ):
            point = JointTrajectoryPoint(positions=positions, velocities=velocities)
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(time_ns, NS_PER_S)
            made.points.append(point)
        return made

    def _find_corridors(
        self, request: NeedleCorridors.Request, response: NeedleCorridors.Response
    ) -> None:
        with alone(self._lock):
            entry = _pose(request.entry, "entry", "disc")
            region = EntryRegion.of_disc(
                entry.target,
                entry.translation_mm,
                entry.rotation[:, 2],
                MM_PER_M * request.entry_radius,
                count=ENTRIES,
            )
            needle = Needle(
                *(MM_PER_M * each for each in (request.length, request.diameter, request.bend))
            )
            content, poses, obstacles = self._guard.read(
                lambda content, step: (
                    content,
                    poses_of(content, step, entry.target),
                    self._guard.obstacles_in(entry.target, step),
                )
            )
            found = plan_corridors(
                content,
                poses,
                region,
                needle,
                target=request.target,
                sigma_mm=MM_PER_M * request.sigma,
                obstacles=obstacles,
            )
        corridors = found.plan.corridors
        self._markers.publish(corridor_markers(found.plan))
        response.entries = [point_message(each.entry_mm) for each in corridors]
        response.targets = [point_message(each.target_mm) for each in corridors]
        response.scores = [each.score for each in corridors]
        response.setup_id, response.registration_id = ids_of(content).values()
        response.plan = json.dumps(found.document, allow_nan=False)
        response.success = True


def _pose(message: PoseStamped, what: str, source: str) -> Transform:
    """Raises `InputError` without a frame and `MarginGuardError` for numbers that are no pose."""
    if not message.header.frame_id:
        raise InputError(f"{what}: has no frame_id; expected the frame of its pose")
    return pose_of(message.pose, message.header.frame_id, source)


_WAY_RGB, _BEST_RGB, _OTHER_RGB = (0.2, 0.6, 1.0), (0.0, 0.9, 0.2), (0.9, 0.9, 0.2)
_BLOCKED = color_message((0.6, 0.1, 0.1), 0.3)
_LINE_M, _GOAL_M, _ENTRY_M = 0.001, 0.006, 0.001


def way_markers(frame_from_root: Transform, tips_mm: FloatArray) -> MarkerArray:
    """The way of the tool's tip, ``tips_mm`` (n, 3) in the root link, and its end."""
    places = frame_from_root.apply(tips_mm)
    way = _marker("planned_way", frame_from_root.target, Marker.LINE_STRIP, _LINE_M, places)
    way.color = color_message(_WAY_RGB)
    goal = _marker("planned_goal", frame_from_root.target, Marker.SPHERE_LIST, _GOAL_M, places[-1:])
    goal.color = color_message(_WAY_RGB)
    return _replacing(way, goal)


def corridor_markers(plan: NeedlePlan) -> MarkerArray:
    """All entries, from yellow to green by their score and red where blocked, and the corridors."""
    frame = plan.region.frame
    entries = _marker("entries", frame, Marker.POINTS, _ENTRY_M, plan.region.points_mm)
    entries.colors = [
        _BLOCKED if math.isnan(score) else color_message((1.0 - score, 0.8, 0.0))
        for score in plan.scores.tolist()
    ]
    corridors = _marker(
        "corridors",
        frame,
        Marker.LINE_LIST,
        _LINE_M,
        (end for each in plan.corridors for end in (each.entry_mm, each.target_mm)),
    )
    corridors.colors = [
        color_message(_OTHER_RGB if number else _BEST_RGB)
        for number in range(len(plan.corridors))
        for _ in range(2)
    ]
    return _replacing(entries, corridors)


def _replacing(*markers: Marker) -> MarkerArray:
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL), *markers])


def _marker(
    name: str, frame: str, kind: int, size_m: float, points_mm: Iterable[FloatArray]
) -> Marker:
    marker = marker_message(name, frame, kind, ColorRGBA(a=1.0))
    marker.points = [point_message(each) for each in points_mm]
    marker.scale.x = marker.scale.y = marker.scale.z = size_m
    return marker
