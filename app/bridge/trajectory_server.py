"""Executes the trajectories of other planners, such as MoveIt, if their path is proven.

==============================  =====================================  =========================
``~/follow_joint_trajectory``   control_msgs/FollowJointTrajectory     as of a ros2_control
                                                                       joint_trajectory_controller
==============================  =====================================  =========================

The path is the straight lines between the points. Its times are kept if the motion rests at its
turns; else it is timed anew, and rests there.
"""

import json
import threading
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from control_msgs.action import FollowJointTrajectory
from numpy.typing import NDArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from app.bridge.calls.action_server import GoalOutcome, ServedGoal
from app.bridge.guard_scene import GuardScene, PathWatch
from app.bridge.messages import header_message, ns_of
from app.bridge.plan_execution import ExecutionNode, ExecutionServer, alone
from app.control import (
    FOLLOW_M,
    FOLLOW_RAD,
    START_M,
    START_RAD,
    ControlDescription,
    ExecutionStep,
    Outcome,
    Plan,
    PlanExecution,
    keeps_to_lines,
    lines_of,
    parse_plan,
)
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError, MarginGuardError, Stamp
from app.planning import (
    MAX_DURATION_S,
    Approach,
    MotionLimits,
    limit_rows,
    prove_path,
    time_path,
)

_Result = FollowJointTrajectory.Result
_MAX_POINTS = 10_000
_FEEDBACK_NS = 100 * NS_PER_MS
_ROUNDED = 1.0 + 1e-6
_STRAIGHT = 1e-9
"""Largest change of a direction that is no turn."""


class TrajectoryGoal(NamedTuple):
    """Points of a trajectory: ``positions`` (k, d) at ``times_ns`` (k,), in rad and m.

    ``velocities`` (k, d) are None if there are none.
    """

    joints: tuple[str, ...]
    times_ns: NDArray[np.int64]
    positions: FloatArray
    velocities: FloatArray | None


class TrajectoryServer:
    """Serves trajectories for the arm of ``description`` with ``executions``.

    A path keeps ``clearance_mm`` from the structures of ``guard``; it is proven with ``lock`` held.
    """

    def __init__(
        self,
        description: ControlDescription,
        arm: ExecutionNode,
        executions: ExecutionServer,
        guard: GuardScene,
        lock: threading.Lock,
        *,
        clearance_mm: float,
    ) -> None:
        self._about, self._tool, self._robot = description, description.tool, description.tool.robot
        self._arm, self._guard, self._lock = arm, guard, lock
        self._clearance_mm = clearance_mm
        executions.serve(FollowJointTrajectory, "~/follow_joint_trajectory", self._run)

    def _run(self, served: ServedGoal) -> tuple[FollowJointTrajectory.Result, GoalOutcome]:
        code = _Result.INVALID_JOINTS
        try:
            joints = self._known_joints(served.request.trajectory)
            code = _Result.INVALID_GOAL
            with alone(self._lock):
                served.on_cancel(self._arm.cancel)
                goal = read_trajectory(served.request, joints)
                plan = self._proven(goal)
                report = partial(self._report, served, joints, plan)
                watch = PathWatch(self._about, self._guard, plan)
                last = self._arm.run(plan, report, every_ns=_FEEDBACK_NS, watch=watch)
        except MarginGuardError as error:
            if not self._arm.is_cancelled():
                return _Result(error_code=code, error_string=str(error)), GoalOutcome.ABORTED
            last = None
        if last is None:
            code, text = _Result.GOAL_TOLERANCE_VIOLATED, "cancelled before it began"
            return _Result(error_code=code, error_string=text), GoalOutcome.CANCELLED
        if last.outcome is Outcome.ARRIVED:
            return _Result(error_code=_Result.SUCCESSFUL), GoalOutcome.SUCCEEDED
        off_path = last.outcome is Outcome.OFF_PATH
        return (
            _Result(
                error_code=_Result.PATH_TOLERANCE_VIOLATED
                if off_path
                else _Result.GOAL_TOLERANCE_VIOLATED,
                error_string=f"stopped after {last.progress:.0%} of the motion: {last.text}",
            ),
            GoalOutcome.CANCELLED if last.outcome is Outcome.CANCELLED else GoalOutcome.ABORTED,
        )

    def _known_joints(self, trajectory: JointTrajectory) -> tuple[str, ...]:
        joints = tuple(trajectory.joint_names)
        if not joints or len(set(joints)) < len(joints) or not set(joints) <= {*self._tool.joints}:
            raise InputError(
                f"joint_names: are {', '.join(joints) or 'missing'}; expected some of "
                f"{', '.join(self._tool.joints)}, each once"
            )
        return joints

    def _proven(self, goal: TrajectoryGoal) -> Plan:
        """The plan of ``goal``, whose path is proven. Raises `MarginGuardError` otherwise."""
        limits = {name: MotionLimits(*each) for name, each in self._about.joint_limits.items()}
        rows = limit_rows(self._robot, goal.joints, limits)
        measured = self._arm.positions()
        goal = with_start(goal, np.array([measured[name] for name in goal.joints]))
        for name, begin in zip(goal.joints, goal.positions[0].tolist(), strict=True):
            tolerance = START_M if self._robot.tree.joint(name).slides else START_RAD
            if abs(measured[name] - begin) > tolerance:
                raise InputError(
                    f"joint {name!r}: is at {measured[name]:.4f}, the trajectory begins at "
                    f"{begin:.4f}; expected at most {tolerance:g} between them"
                )
        held = {name: value for name, value in measured.items() if name not in goal.joints}
        motion = timed(goal, rows, self._arm.is_cancelled)
        scene, obstacles = self._guard.read(self._guard.scene_with_obstacles)
        approach = Approach(
            goal.joints,
            held,
            *motion,
            self._clearance_mm,
            {
                name: MotionLimits(acceleration, jerk, velocity)
                for name, (velocity, acceleration, jerk) in zip(goal.joints, rows.T, strict=True)
            },
            ("the trajectory of another node; its path is proven",),
            scene.ids,
        )
        document = approach.as_document(self._robot.name)
        plan = parse_plan(json.dumps(document, allow_nan=False), "trajectory")
        PlanExecution(self._about, plan.motion)  # which checks the limits
        prove_path(
            self._robot,
            goal.joints,
            held,
            approach.positions,
            {**scene.structures, **obstacles},
            clearance_mm=self._clearance_mm,
            carried=scene.carried,
            is_over=self._arm.is_cancelled,
        )
        return plan

    def _report(
        self, served: ServedGoal, joints: tuple[str, ...], plan: Plan, step: ExecutionStep
    ) -> None:
        measured = self._arm.measured()
        if measured is None:
            return
        columns = [self._tool.joints.index(name) for name in joints]
        desired, actual = step.positions[columns], measured[columns]
        points = {
            "desired": JointTrajectoryPoint(
                positions=desired.tolist(), velocities=step.velocities[columns].tolist()
            ),
            "actual": JointTrajectoryPoint(positions=actual.tolist()),
            "error": JointTrajectoryPoint(positions=(desired - actual).tolist()),
        }
        at_ns = round(step.progress * int(plan.motion.times_ns[-1]))
        for point in points.values():
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(at_ns, NS_PER_S)
        served.feedback(
            FollowJointTrajectory.Feedback(
                header=header_message("", Stamp(self._arm.now_ns())),
                joint_names=list(joints),
                **points,
            )
        )


def read_trajectory(goal: FollowJointTrajectory.Goal, joints: tuple[str, ...]) -> TrajectoryGoal:
    """The points of ``goal``. Raises `InputError` for what is not a motion, or cannot be kept."""
    _check_unused(goal)
    points = goal.trajectory.points
    if not 0 < len(points) <= _MAX_POINTS:
        raise InputError(f"trajectory: has {len(points)} points; expected 1 to {_MAX_POINTS}")
    times_ns = np.array([ns_of(each.time_from_start) for each in points])
    if times_ns[0] < 0 or (np.diff(times_ns) <= 0).any():
        raise InputError("time_from_start: does not increase from 0; expected increasing times")
    rows = {}
    for name in ("positions", "velocities"):
        given = [getattr(each, name) for each in points]
        if name == "velocities" and not any(len(each) for each in given):
            continue
        number = next((k for k, each in enumerate(given) if len(each) != len(joints)), None)
        if number is not None:
            raise InputError(
                f"point {number}: has {len(given[number])} {name}; expected {len(joints)}"
            )
        rows[name] = np.array(given, dtype=np.float64)
        if not np.isfinite(rows[name]).all():
            raise InputError(f"trajectory: has {name} that are not finite; expected numbers")
    return TrajectoryGoal(joints, times_ns, rows["positions"], rows.get("velocities"))


def _check_unused(goal: FollowJointTrajectory.Goal) -> None:
    """Raise `InputError` for values of ``goal`` that the execution would not keep."""
    if ns_of(goal.trajectory.header.stamp):
        raise InputError("header.stamp: is not 0; expected 0, for a motion that begins at once")
    if goal.multi_dof_trajectory.points or goal.multi_dof_trajectory.joint_names:
        raise InputError("multi_dof_trajectory: has joints; expected none")
    if any(len(each.effort) for each in goal.trajectory.points):
        raise InputError("effort: is given; expected none")
    late_ns = ns_of(goal.goal_time_tolerance)
    if late_ns:
        raise InputError(
            f"goal_time_tolerance: is {late_ns / NS_PER_S:g} s; expected 0: the constraint may "
            "slow the motion down"
        )
    if goal.component_path_tolerance or goal.component_goal_tolerance:
        raise InputError("component tolerances: are given; expected none")
    least = max(FOLLOW_RAD, FOLLOW_M)
    for each in (*goal.path_tolerance, *goal.goal_tolerance):
        if each.velocity > 0.0 or each.acceleration > 0.0 or 0.0 < each.position < least:
            raise InputError(
                f"tolerance of joint {each.name!r}: is given; expected none, or a position of at "
                f"least {least:g}"
            )


def with_start(goal: TrajectoryGoal, start: FloatArray) -> TrajectoryGoal:
    """``goal`` from ``start`` (d,) at rest, unless it has a point at the time 0."""
    if goal.times_ns[0] == 0:
        return goal
    velocities = goal.velocities
    if velocities is not None:
        velocities = np.concatenate([np.zeros((1, len(start))), velocities])
    return TrajectoryGoal(
        goal.joints,
        np.concatenate([[0], goal.times_ns]),
        np.concatenate([start[None], goal.positions]),
        velocities,
    )


def timed(
    goal: TrajectoryGoal, limits: FloatArray, is_over: Callable[[], bool] = lambda: False
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Times (n,) in ns, positions and velocities (n, d) of a motion along the lines of ``goal``.

    ``limits`` (3, d) are those of `limit_rows`. Raises `InputError` for a goal that is faster or
    takes longer than `MAX_DURATION_S`, and when ``is_over``.
    """
    spans_s = np.diff(goal.times_ns)[:, None] / NS_PER_S
    speeds = np.abs(np.diff(goal.positions, axis=0)) / spans_s
    fast = (speeds > _ROUNDED * limits[0]).any(axis=0)
    if fast.any():
        column = int(np.flatnonzero(fast)[0])
        raise InputError(
            f"joint {goal.joints[column]!r}: moves with {speeds[:, column].max():g} per s; "
            f"expected at most {limits[0, column]:g}"
        )
    velocities = goal.velocities
    if velocities is not None and keeps_to_lines(velocities, lines_of(goal.positions)[1]):
        duration_s = int(goal.times_ns[-1]) / NS_PER_S
        if duration_s > MAX_DURATION_S:
            raise InputError(
                f"trajectory: takes {duration_s:g} s; expected at most {MAX_DURATION_S:g}"
            )
        return goal.times_ns, goal.positions, velocities
    return time_path(_turns(goal.positions), limits, is_over)


def _turns(positions: FloatArray) -> FloatArray:
    """The first and the last of ``positions`` (k, d), and those where their line turns."""
    lengths, lines = lines_of(positions)
    moving = np.flatnonzero(lengths[:, 0] > 0.0)
    turns = np.abs(np.diff(lines[moving], axis=0)).max(axis=1, initial=0.0) > _STRAIGHT
    return positions[[0, *moving[1:][turns].tolist(), len(positions) - 1]]
