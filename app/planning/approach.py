"""Approach of a robot: from joint positions to others, or to a pose of a link, touching nothing."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError, MarginGuardError, SurfaceMesh, Transform
from app.planning.collision import CollisionModel
from app.planning.path_timing import MotionLimits, limit_rows, time_path
from app.robot import IkOptions, JointType, Robot, UnreachableError

_MAX_SOLUTIONS = 8
_MAX_STARTS = 60
"""Starts of inverse kinematics for several solutions of a pose."""

_SAME_RAD = 1e-4
_SEED = 20240611


class ApproachError(MarginGuardError):
    """There is no approach: start or goal in collision, goal out of reach, or no path in time."""


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """A trajectory that keeps ``clearance_mm`` from all structures, and what it was made from.

    ``times_ns`` (n,) from 0, ``positions`` and ``velocities`` (n, d) are of ``joints``, in rad, for
    sliding joints in m; on the straight line between two samples the clearance is kept as well. The
    joints that are not named stay at ``held``. ``limits`` are those that were used, ``reasons``
    sentences on how it was found, ``made_from`` the ids that were given, such as those of
    registration and structures.
    """

    joints: tuple[str, ...]
    held: Mapping[str, float]
    times_ns: NDArray[np.int64]
    positions: FloatArray
    velocities: FloatArray
    clearance_mm: float
    limits: Mapping[str, MotionLimits]
    reasons: tuple[str, ...]
    made_from: Mapping[str, str]

    def is_valid_for(self, ids: Mapping[str, str]) -> bool:
        """True if ``ids`` are those that the approach was made from; without ids never."""
        return bool(self.made_from) and dict(self.made_from) == dict(ids)

    def as_document(self, robot: str) -> dict[str, Any]:
        """The approach of ``robot``, by its name, as JSON types."""
        return {
            "robot": robot,
            "joints": list(self.joints),
            "held": dict(self.held),
            "limits": {name: asdict(limits) for name, limits in self.limits.items()},
            "clearance_mm": self.clearance_mm,
            "made_from": dict(self.made_from),
            "reasons": list(self.reasons),
            "times_ns": self.times_ns.tolist(),
            "positions": self.positions.tolist(),
            "velocities": self.velocities.tolist(),
        }


def plan_approach(
    robot: Robot,
    start: Mapping[str, float],
    goal: Mapping[str, float] | Transform,
    structures: Mapping[str, SurfaceMesh],
    *,
    clearance_mm: float,
    limits: Mapping[str, MotionLimits],
    carried: Mapping[str, SurfaceMesh] | None = None,
    is_over: Callable[[], bool],
    made_from: Mapping[str, str] | None = None,
) -> Approach:
    """Plan a motion that keeps ``clearance_mm`` from ``structures`` between states too.

    ``start`` has the positions (rad, m) of all actuated joints. ``goal`` has those of the joints
    that move, or is ``root_from_link`` of a link: then all joints that move it do. The others stay.
    ``structures`` are closed surfaces in the root link's frame, ``carried`` bodies in the frames of
    links (`CollisionModel` says which pairs are tested). ``limits`` are by joint. ``made_from`` are
    ids that the result keeps.

    The search ends when ``is_over``: then a path that was found is not shortened any more. It
    is asked often, and says that the time is up or that the operator has cancelled.

    Raises `InputError` for unknown or missing joints, positions outside of their limits and numbers
    that are not finite, `ApproachError` for a start or goal in collision, a goal out of reach and
    no path in time, and the errors of `CollisionModel`.
    """
    from app.planning.path_search import find_path, shorten_path  # OMPL is of an extra

    everything = dict(_checked_positions(robot, start, "start"))
    missing = [name for name in robot.actuated_joint_names if name not in everything]
    if missing:
        raise InputError(f"start: joint {missing[0]!r} has no position; expected all joints")
    if isinstance(goal, Transform):
        moving = robot.tree.joints_that_move(goal.source)
    else:
        moving = frozenset(_checked_positions(robot, goal, "goal"))
    joints = tuple(name for name in robot.actuated_joint_names if name in moving)
    if not joints:
        raise InputError("goal: moves no joint; expected at least one")
    _check_limits(robot, joints)
    held = {name: value for name, value in everything.items() if name not in joints}
    rows = limit_rows(robot, joints, limits)
    model = CollisionModel(
        robot, joints, held, structures, clearance_mm=clearance_mm, carried=carried or {}
    )
    first = np.array([everything[name] for name in joints])
    contact = model.contact_at(first)
    if contact is not None:
        raise ApproachError(f"start: {contact}")
    goals = _free_goals(robot, model, everything, goal, is_over)
    low, high = _ranges(robot, joints)
    low = np.where(np.isinf(low), first - math.tau, low)
    high = np.where(np.isinf(high), first + math.tau, high)
    found = find_path(model, first, goals, (low, high), is_over)
    if found is None:
        raise ApproachError(
            "approach: no path found in the time allowed; expected free space between start and "
            "goal, or more time"
        )
    path = shorten_path(model, found, rows[0], is_over)
    times_ns, positions, velocities = time_path(path, rows)
    for array in (times_ns, positions, velocities):
        array.flags.writeable = False
    return Approach(
        joints,
        held,
        times_ns,
        positions,
        velocities,
        clearance_mm,
        {
            name: MotionLimits(acceleration, jerk, velocity)
            for name, (velocity, acceleration, jerk) in zip(joints, rows.T.tolist(), strict=True)
        },
        _reasons(found, path, len(goals)),
        dict(made_from or {}),
    )


def prove_path(
    robot: Robot,
    joints: tuple[str, ...],
    held: Mapping[str, float],
    states: FloatArray,
    structures: Mapping[str, SurfaceMesh],
    *,
    clearance_mm: float,
    carried: Mapping[str, SurfaceMesh],
    is_over: Callable[[], bool] = lambda: False,
) -> None:
    """Raise `ApproachError` unless the lines between ``states`` (k, d) keep all clearances.

    The bodies and their clearances are those of `plan_approach`, and so is the proof. Raises it,
    too, when ``is_over``, which is asked at each line, and the errors of `CollisionModel`.
    """
    model = CollisionModel(
        robot, joints, held, structures, clearance_mm=clearance_mm, carried=carried
    )
    contact = model.contact_at(states[0])
    if contact is not None:
        raise ApproachError(f"start: {contact}")
    for number, part in enumerate(pairwise(states)):
        if is_over():
            raise ApproachError("path: its proof was ended; expected the time for it")
        bodies = model.blocking_bodies(*part)
        if bodies is not None:
            raise ApproachError(
                f"path: after {number} of {len(states) - 1} parts {bodies[0]} is not proven to "
                f"keep its clearance from {bodies[1]}; expected {clearance_mm:g} mm from structures"
            )


def _reasons(found: FloatArray, path: FloatArray, goals: int) -> tuple[str, ...]:
    lengths = [float(np.linalg.norm(np.diff(each, axis=0), axis=1).sum()) for each in (found, path)]
    searched = (
        "the straight motion to the nearest goal is free"
        if len(found) == 2
        else f"the straight motion is not free; a search found {len(found) - 2} via states"
    )
    return (
        f"{goals} free joint positions reach the goal",
        searched,
        f"shortcuts leave {len(path) - 2} via states, at which the arm stops, and "
        f"{lengths[1]:.3g} of {lengths[0]:.3g} rad",
    )


def _ranges(robot: Robot, joints: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Limits (d,) of joints, narrowed by those of the joints that follow them."""
    tree = robot.tree
    low = np.array([tree.joint(name).lower for name in joints])
    high = np.array([tree.joint(name).upper for name in joints])
    at_zero = robot.complete_positions({})
    for joint in tree.joints:
        if joint.moves and joint.mimic is not None:
            leader, gain = tree.driver_of(joint)
            if leader in joints and gain != 0.0:
                ends = [(end - at_zero[joint.name]) / gain for end in (joint.lower, joint.upper)]
                column = joints.index(leader)
                low[column] = max(low[column], min(ends))
                high[column] = min(high[column], max(ends))
    return low, high


def _check_limits(robot: Robot, joints: tuple[str, ...]) -> None:
    """Raise `InputError` unless all joints have limits, but those that turn without end."""
    for name, low, high in zip(joints, *_ranges(robot, joints), strict=True):
        if np.isinf([low, high]).any() and robot.tree.joint(name).type is not JointType.CONTINUOUS:
            raise InputError(
                f"joint {name!r}: has limits {low:g} to {high:g}; expected finite ones"
            )


def _checked_positions(
    robot: Robot, positions: Mapping[str, float], what: str
) -> Mapping[str, float]:
    """Return ``positions``; raise `InputError` unless all are of actuated joints, within limits."""
    known = robot.actuated_joint_names
    for name in positions:
        if name not in known:
            raise InputError(f"{what}: joint {name!r} is unknown; expected {', '.join(known)}")
    low, high = _ranges(robot, tuple(positions))
    for (name, position), lowest, highest in zip(positions.items(), low, high, strict=True):
        if not (math.isfinite(position) and lowest <= position <= highest):
            raise InputError(
                f"{what}: joint {name!r} is at {position:g}; expected {lowest:g} to {highest:g}"
            )
    return positions


def _free_goals(
    robot: Robot,
    model: CollisionModel,
    start: Mapping[str, float],
    goal: Mapping[str, float] | Transform,
    is_over: Callable[[], bool],
) -> FloatArray:
    """Positions (g, d) of the model's joints that reach the goal and are free.

    Raises `ApproachError` if there are none, with the first contact.
    """
    first = np.array([start[name] for name in model.joints])
    if isinstance(goal, Transform):
        states = list(_solutions(robot, model.joints, start, goal, is_over))
    else:
        states = [np.array([goal[name] for name in model.joints])]
    contacts = [model.contact_at(state) for state in states]
    free = [state for state, contact in zip(states, contacts, strict=True) if contact is None]
    if not free:
        raise ApproachError(f"goal: {contacts[0]}")
    endless = np.isinf(_ranges(robot, model.joints)[0])
    goals = []
    for state in free:
        # A joint without limits reaches its goal either way round.
        nearest = first + np.remainder(state - first + math.pi, math.tau) - math.pi
        other = nearest - np.copysign(math.tau, nearest - first)
        choices = [
            (near, far) if turns else (value,)
            for value, near, far, turns in zip(state, nearest, other, endless, strict=True)
        ]
        goals += list(product(*choices))
    return np.array(goals)


def _solutions(
    robot: Robot,
    joints: tuple[str, ...],
    start: Mapping[str, float],
    goal: Transform,
    is_over: Callable[[], bool],
) -> Iterator[FloatArray]:
    """Different solutions of inverse kinematics, the first from the start's branch.

    Raises `ApproachError` for a pose out of reach.
    """
    low, high = _ranges(robot, joints)
    bounds = np.where(np.isinf(low), -math.pi, low), np.where(np.isinf(high), math.pi, high)
    first = np.array([start[name] for name in joints])
    slides = np.array([robot.tree.joint(name).slides for name in joints])
    rng = np.random.default_rng(_SEED)
    found: list[FloatArray] = []
    try:
        solution = robot.inverse_kinematics(goal.source, goal, seed=start)
    except UnreachableError as error:
        raise ApproachError(f"goal: {error}; expected a pose within reach") from error
    for _ in range(_MAX_STARTS):
        state = np.array([solution[name] for name in joints])
        # Whole turns of joints that bring them nearest to the start give the same pose.
        turns = math.tau * np.round((first - state) / math.tau)
        turned = np.where(slides, state, state + turns)
        state = np.where((turned >= low) & (turned <= high), turned, state)
        if all(np.abs(state - each).max() > _SAME_RAD for each in found):
            found.append(state)
            yield state
        if len(found) == _MAX_SOLUTIONS or is_over():
            return
        seed = dict(
            zip(joints, bounds[0] + (bounds[1] - bounds[0]) * rng.random(len(joints)), strict=True)
        )
        try:
            solution = robot.inverse_kinematics(
                goal.source, goal, seed={**start, **seed}, options=IkOptions(restarts=0)
            )
        except UnreachableError:
            continue
