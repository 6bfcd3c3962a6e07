"""Inverse kinematics: joint positions, within their limits, that move a link to a pose.

Damped least squares (Wampler 1986; Nakamura and Hanafusa 1986) with the damping of Levenberg and
Marquardt: decreased while the error falls, increased while it does not. Near the solution the
damping vanishes and the steps are Newton's, with quadratic convergence.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from app.geometry import FloatArray, Transform
from app.geometry.rotations import vector_of_rotation
from app.robot.elements import Joint, JointError, UnreachableError
from app.robot.kinematic_tree import KinematicTree

MM_PER_RAD = 100.0
"""Weight of angles against lengths in the minimised error: 1 rad counts as 100 mm."""

_WEIGHTS = np.repeat([1.0, MM_PER_RAD], 3)[:, None]

MIN_COST_DROP = 1e-4
"""A step that lowers the squared error by a smaller fraction is at a local minimum that is not a
solution: near a solution the error falls by orders of magnitude a step."""


@dataclass(frozen=True, slots=True)
class IkOptions:
    """Tolerances of a solution, and limits of the search.

    ``restarts`` is the number of further starting points within the limits, a fixed sequence, that
    are tried when the first one fails. 0 keeps a motion on the branch of its seed.
    """

    tolerance_mm: float = 1e-7
    tolerance_rad: float = 1e-9
    max_iterations: int = 200
    restarts: int = 200

    def __post_init__(self) -> None:
        if not (self.tolerance_mm > 0.0 and self.tolerance_rad > 0.0):
            raise JointError(
                f"tolerances of inverse kinematics are {self.tolerance_mm} mm and "
                f"{self.tolerance_rad} rad; expected values above 0"
            )
        if self.max_iterations < 1 or self.restarts < 0:
            raise JointError(
                f"inverse kinematics has {self.max_iterations} iterations and {self.restarts} "
                "restarts; expected at least 1 and at least 0"
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    positions: FloatArray
    matrices: FloatArray
    error: FloatArray
    cost: float

    @property
    def residual_mm(self) -> float:
        return math.sqrt(float(self.error[:3] @ self.error[:3]))

    @property
    def residual_rad(self) -> float:
        return math.sqrt(float(self.error[3:] @ self.error[3:])) / MM_PER_RAD

    def is_solution(self, options: IkOptions) -> bool:
        return (
            self.residual_mm <= options.tolerance_mm and self.residual_rad <= options.tolerance_rad
        )


class _Chain:
    """The actuated joints that move a link, in order, their limits (n,), and compiled arrays.

    ``moving`` has the name of each moving joint of the tree, None for the others, ``arrays`` the
    arguments of `link_kernel.descend` that are the same for all goals.
    """

    def __init__(self, tree: KinematicTree, link: str) -> None:
        self.names = tree.drivers_to(link)
        self.drivers = tuple(tree.joint(name) for name in self.names)
        self.lower, self.upper = _limits(tree, link, self.drivers, self.names)
        self.moving = [joint.name if joint.moves else None for joint in tree.joints]
        leaders = [tree.driver_of(each) if each.moves else ("", 0.0) for each in tree.joints]
        columns = [self.names.index(name) if name in self.names else -1 for name, _ in leaders]
        self.arrays: tuple[Any, ...] = (
            np.array(columns, np.int64),
            np.array([gain for _, gain in leaders]),
            *tree.compiled_arrays(link, tuple(self.names)),
        )


_chains: WeakKeyDictionary[KinematicTree, dict[str, _Chain]] = WeakKeyDictionary()


def _chain_to(tree: KinematicTree, link: str) -> _Chain:
    """The joints that move ``link``, found once for each tree.

    An arm that follows a path asks thousands of times.
    """
    chains = _chains.setdefault(tree, {})
    if link not in chains:
        chains[link] = _Chain(tree, link)
    return chains[link]


def _limits(
    tree: KinematicTree, link: str, drivers: Sequence[Joint], names: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Limits (n,) of the drivers, narrowed by those of their mimic joints."""
    lower = np.array([joint.lower for joint in drivers])
    upper = np.array([joint.upper for joint in drivers])
    base = tree.complete_positions(dict.fromkeys(names, 0.0))
    for joint in tree.path_to(link):
        if joint.mimic is None or not joint.moves:
            continue
        driver, gain = tree.driver_of(joint)
        if gain == 0.0:
            continue
        ends = sorted((end - base[joint.name]) / gain for end in (joint.lower, joint.upper))
        column = names.index(driver)
        lower[column] = max(lower[column], ends[0])
        upper[column] = min(upper[column], ends[1])
        if lower[column] > upper[column]:
            raise UnreachableError(
                f"joint {driver!r} has no position within the limits of its follower {joint.name!r}"
            )
    return lower, upper


class _Problem:
    """One link, its goal pose, and the actuated joints that move it."""

    def __init__(
        self, tree: KinematicTree, link: str, goal: Transform, fixed: Mapping[str, float]
    ) -> None:
        self.tree, self.link, self.goal = tree, link, goal
        self.chain = _chain_to(tree, link)
        self.names, self.lower, self.upper = self.chain.names, self.chain.lower, self.chain.upper
        self.fixed = {name: value for name, value in fixed.items() if name not in self.names}

    def matrices(self, positions: FloatArray) -> FloatArray:
        given = {**self.fixed, **dict(zip(self.names, positions.tolist(), strict=True))}
        return self.tree.link_matrices(self.tree.complete_positions(given))

    def attempt(self, positions: FloatArray) -> _Attempt:
        """Evaluate ``positions``; the error is infinite where a loop of links does not close."""
        try:
            matrices = self.matrices(positions)
        except JointError:
            if not self.tree.dependent:
                raise
            return _Attempt(positions, np.empty((0, 4, 4)), np.full(6, math.inf), math.inf)
        reached = matrices[self.tree.link_rows[self.link]]
        turn = vector_of_rotation(self.goal.rotation @ reached[:3, :3].T)
        shift = self.goal.translation_mm - reached[:3, 3]
        error = np.concatenate([shift, MM_PER_RAD * turn])
        return _Attempt(positions, matrices, error, float(error @ error))

    def starts(self, seed: Mapping[str, float], restarts: int) -> Iterator[FloatArray]:
        """The seed, by default the middle of the range, then a fixed, even spread of points."""
        low = np.where(np.isfinite(self.lower), self.lower, -math.pi)
        high = np.where(np.isfinite(self.upper), self.upper, math.pi)
        middle = 0.5 * (low + high)
        first = np.array(
            [seed.get(name, mid) for name, mid in zip(self.names, middle, strict=True)]
        )
        yield np.clip(first, self.lower, self.upper)
        if restarts and self.names:
            from scipy.stats import qmc  # slow to load, and only restarts need it

            spread = qmc.Halton(len(self.names), scramble=False).random(restarts)
            yield from low + (high - low) * spread

    def minimise(self, start: FloatArray, options: IkOptions) -> _Attempt:
        """Descend from ``start`` to a local minimum of the error within the limits."""
        if self.tree.dependent or not self.names:
            return self.minimise_uncompiled(start, options)
        from app.robot.link_kernel import descend  # slow

        base = self.tree.complete_positions({**self.fixed, **dict.fromkeys(self.names, 0.0)})
        offsets = np.array([0.0 if name is None else base[name] for name in self.chain.moving])
        positions, error = np.empty(len(start)), np.empty(6)
        kernel: Any = descend  # its types are numba's
        is_finite = kernel(
            np.ascontiguousarray(start, dtype=np.float64),
            self.lower,
            self.upper,
            self.goal.matrix,
            offsets,
            *self.chain.arrays,
            MM_PER_RAD,
            options.tolerance_mm,
            options.tolerance_rad,
            options.max_iterations,
            MIN_COST_DROP,
            positions,
            error,
        )
        if not is_finite:
            return self.minimise_uncompiled(start, options)
        return _Attempt(positions, np.empty((0, 4, 4)), error, float(error @ error))

    def minimise_uncompiled(self, start: FloatArray, options: IkOptions) -> _Attempt:
        """`minimise` for any tree: in one with closed loops the poses need a search of their own.

        Raises `JointError` where a pose is not finite.
        """
        best, damping = self.attempt(start), 1e-2
        for _ in range(options.max_iterations):
            if best.is_solution(options) or damping > 1e8 or math.isinf(best.cost):
                break
            jacobian = _WEIGHTS * self.tree.jacobian(self.link, self.names, best.matrices)
            gradient = jacobian.T @ best.error
            # A joint at a limit, with a step beyond it, is held in this step.
            at_limit = ((best.positions <= self.lower) & (gradient < 0.0)) | (
                (best.positions >= self.upper) & (gradient > 0.0)
            )
            free = ~at_limit
            if not free.any():
                break
            normal = jacobian[:, free].T @ jacobian[:, free]
            diagonal = normal.diagonal()
            scale = diagonal + 1e-9 * max(float(diagonal.sum()), 1e-12)
            np.fill_diagonal(normal, diagonal + damping * scale)
            step = np.zeros(len(self.names))
            step[free] = np.linalg.solve(normal, gradient[free])
            # At most half a turn: the linear model is not valid beyond it.
            step *= min(1.0, math.pi / max(float(np.abs(step).max()), 1e-300))
            reached = np.minimum(np.maximum(best.positions + step, self.lower), self.upper)
            trial = self.attempt(reached)
            if trial.cost < best.cost:
                stalled = trial.cost > (1.0 - MIN_COST_DROP) * best.cost
                best, damping = trial, max(damping * 0.1, 1e-15)
                if stalled:
                    break
            else:
                damping *= 10.0
        return best


def inverse_kinematics(
    tree: KinematicTree,
    link: str,
    root_from_link: Transform,
    seed: Mapping[str, float],
    options: IkOptions,
) -> dict[str, float]:
    """Return positions (rad, m) of all actuated joints that move ``link`` to ``root_from_link``.

    Joints that do not move ``link`` keep their seed, or 0. The branch of the seed is searched
    first. The result is deterministic. Raises `UnreachableError` with the smallest residual when
    no start leads to the pose, and `JointError` for a seed of an unknown or a mimic joint.
    """
    actuated = [
        joint
        for joint in tree.joints
        if joint.moves and joint.mimic is None and joint.name not in tree.dependent
    ]
    known = {joint.name for joint in actuated}
    for name in seed:
        if tree.joint(name).name not in known:
            kind = "follows from a closed loop" if name in tree.dependent else "is a mimic joint"
            raise JointError(f"joint {name!r} {kind}; expected a seed of the joints that lead it")
    positions = tree.complete_positions(seed)
    problem = _Problem(tree, link, root_from_link, {name: positions[name] for name in known})
    starts = problem.starts(seed, options.restarts)
    best = problem.minimise(next(starts), options)
    while not best.is_solution(options):
        other = next(starts, None)  # the first of these computes the whole sequence
        if other is None:
            break
        best = min(best, problem.minimise(other, options), key=lambda attempt: attempt.cost)
    if not best.is_solution(options):
        raise UnreachableError(
            f"link {link!r} cannot be moved to {root_from_link.translation_mm.round(3).tolist()} "
            f"mm within the joint limits; the nearest pose is {best.residual_mm:.3g} mm and "
            f"{best.residual_rad:.3g} rad away"
        )
    found = dict(zip(problem.names, best.positions.tolist(), strict=True))
    for joint in problem.chain.drivers:
        if math.isinf(joint.lower) and not joint.slides:
            start = seed.get(joint.name, 0.0)
            found[joint.name] = start + math.remainder(found[joint.name] - start, math.tau)
    return {joint.name: found.get(joint.name, positions[joint.name]) for joint in actuated}
