"""Path in joint space from a start to one of several goals, and its shortening.

OMPL searches. A proof of a motion takes much longer than a test of some states, and most motions of
a search are not on the path that it finds: only this one is proven. If that fails, it is searched
again with finer tests, down to proofs (after the lazy planner of Bohlin and Kavraki 2000).

A joint that turns several times has the same pose at several positions. So the first search is near
the ends, where each pose is once or twice. Later ones alternate between that and all limits: some
paths, such as out of a winding, lead through more turns.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from ompl import base, geometric, util

from app.geometry import FloatArray
from app.planning.collision import CollisionModel

_SEED = 1

ASSUMED_MM = 64.0
"""Motion of any point between two states that the first search tests."""

_FINER = 4.0
_PROVEN_MM = 0.01

_NEAR = math.pi
"""Beyond start and goals, in rad or m: as far as the searches near them go."""

_STEP = 2.0
"""Longest motion of a tree, in rad or m: most of those that are longer are blocked."""

_MOTIONS = 1000
"""Tested motions after which the first two searches begin anew; later ones test more."""

_SHORTCUTS = 60

util.setLogLevel(util.LOG_ERROR)
util.RNG.setSeed(_SEED)


class _TestedMotions(base.MotionValidator):  # type: ignore[misc]  # OMPL has no types
    """Motions that `CollisionModel` tests with ``assumed_mm``.

    OMPL asks for a state before the motion from it back to a tree: that motion tests it first.
    """

    def __init__(
        self, space: base.SpaceInformation, model: CollisionModel, assumed_mm: float
    ) -> None:
        super().__init__(space)
        self._model, self._assumed_mm = model, assumed_mm
        self._new = np.empty(0)
        self.tested = 0

    def accepts(self, state: base.State) -> bool:
        """True: the motion from the state tests it."""
        self._new = _array(state, len(self._model.joints))
        return True

    def checkMotion(self, start: base.State, end: base.State) -> bool:  # noqa: N802 (of OMPL)
        """True if the straight motion keeps all clearances, as far as it is tested."""
        ends = [_array(state, len(self._model.joints)) for state in (start, end)]
        if np.array_equal(ends[0], self._new):
            ends.reverse()
        self.tested += 1
        return self._model.motion_keeps_clearance(*ends, assumed_mm=self._assumed_mm)


def _array(state: base.State, count: int) -> FloatArray:
    return np.array([state[joint] for joint in range(count)])


def find_path(
    model: CollisionModel,
    start: FloatArray,
    goals: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    is_over: Callable[[], bool],
) -> FloatArray | None:
    """States (k, d) of a proven path from ``start`` (d,) to one of ``goals`` (g, d), or None.

    Start and goals are within ``limits``, keep their clearances and are inside of nothing. A
    straight motion is tried first, to the nearest goal, then RRTConnect (Kuffner and LaValle 2000)
    until ``is_over``.
    """
    nearest = goals[np.linalg.norm(goals - start, axis=1).argmin()]
    if model.motion_keeps_clearance(start, nearest):
        return np.array([start, nearest])
    ends = np.vstack([start, goals])
    near = (
        np.maximum(limits[0], ends.min(axis=0) - _NEAR),
        np.minimum(limits[1], ends.max(axis=0) + _NEAR),
    )
    assumed_mm, searches = ASSUMED_MM, 0
    while not is_over():
        within, motions = limits if searches % 2 else near, _MOTIONS << searches // 2
        path = _tested_path(model, start, goals, within, is_over, assumed_mm, motions)
        if path is None:
            searches += 1
        elif assumed_mm == 0.0 or all(
            model.motion_keeps_clearance(*part) for part in pairwise(path)
        ):
            return path
        else:
            assumed_mm = assumed_mm / _FINER if assumed_mm > _PROVEN_MM else 0.0
    return None


def _tested_path(
    model: CollisionModel,
    start: FloatArray,
    goals: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    is_over: Callable[[], bool],
    assumed_mm: float,
    max_motions: int,
) -> FloatArray | None:
    """Path by RRTConnect whose motions are tested with ``assumed_mm``.

    None when ``is_over``, or after ``max_motions``.
    """
    count = len(start)
    bounds = base.RealVectorBounds(count)
    for joint, (low, high) in enumerate(zip(*limits, strict=True)):
        bounds.setLow(joint, float(low))
        bounds.setHigh(joint, float(high))
    states = base.RealVectorStateSpace(count)
    states.setBounds(bounds)
    space = base.SpaceInformation(states)
    motions = _TestedMotions(space, model, assumed_mm)
    space.setStateValidityChecker(motions.accepts)
    space.setMotionValidator(motions)
    space.setup()
    problem = base.ProblemDefinition(space)
    problem.addStartState(_state(states, start))
    goal = base.GoalStates(space)
    for each in goals:
        goal.addState(_state(states, each))
    problem.setGoal(goal)
    planner = geometric.RRTConnect(space)
    planner.setRange(_STEP)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(
        base.PlannerTerminationCondition(lambda: motions.tested >= max_motions or is_over())
    )
    if not problem.hasExactSolution():
        return None
    return np.array([_array(state, count) for state in problem.getSolutionPath().getStates()])


def _state(space: base.RealVectorStateSpace, positions: FloatArray) -> base.State:
    state = space.allocState()
    for joint, position in enumerate(positions.tolist()):
        state[joint] = position
    return state


def shorten_path(
    model: CollisionModel, path: FloatArray, speeds: FloatArray, is_over: Callable[[], bool]
) -> FloatArray:
    """A path of less time between the same ends: shortcuts that ``model`` proves.

    ``speeds`` (d,) are those of the joints. First via states are left out, then ``_SHORTCUTS``
    pairs of random points of the path are joined, then via states are left out again.
    """
    rng = np.random.default_rng(_SEED)
    path = _without_detours(model, path, is_over)
    for _ in range(_SHORTCUTS):
        if len(path) < 3 or is_over():
            break
        times = np.concatenate([[0.0], np.cumsum(_durations(path, speeds))])
        first, last = np.sort(rng.random(2)) * times[-1]
        i, j = np.searchsorted(times, [first, last], side="right") - 1
        if i == j:
            continue
        ends = np.array(
            [[np.interp(at, times, column) for column in path.T] for at in (first, last)]
        )
        shorter = np.concatenate([path[: i + 1], ends, path[j + 1 :]])
        saved = times[-1] - _durations(shorter, speeds).sum()
        if saved > 1e-3 * times[-1] and model.motion_keeps_clearance(*ends):
            path = shorter
    return _without_detours(model, path, is_over)


def _durations(path: FloatArray, speeds: FloatArray) -> FloatArray:
    """Time (k - 1,) of each part at full speed."""
    return np.asarray((np.abs(np.diff(path, axis=0)) / speeds).max(axis=1))


def _without_detours(
    model: CollisionModel, path: FloatArray, is_over: Callable[[], bool]
) -> FloatArray:
    """The path without via states that can be left out, the longest shortcuts first."""
    kept, at = [path[0]], 0
    while at < len(path) - 1:
        onward = at + 1
        for later in range(len(path) - 1, at + 1, -1):
            if is_over():
                break
            if model.motion_keeps_clearance(path[at], path[later]):
                onward = later
                break
        kept.append(path[onward])
        at = onward
    return np.array(kept)
