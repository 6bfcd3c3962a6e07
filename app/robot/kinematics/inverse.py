"""Inverse kinematics: joint positions that bring a link to a pose, within the joints' limits.

Damped least squares (Wampler 1986; Nakamura and Hanafusa 1986) with the damping of Levenberg and
Marquardt: lowered while the error falls, raised while it does not. Near the solution the damping
vanishes and the steps are Newton's, so the last digits come cheaply.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from app.geometry import FloatArray, Transform
from app.robot.errors import JointError, UnreachableError
from app.robot.kinematics.joint import Joint
from app.robot.kinematics.tree import KinematicTree

MM_PER_RAD = 100.0
"""Weighs angles against lengths in the error that is minimised: at 100 mm, a hand's breadth."""

STALL = 1e-4
"""A step that lowers the squared error by less than this fraction has come to a place that is no
solution: at a solution the error falls by orders of magnitude a step."""


@dataclass(frozen=True, slots=True)
class IkOptions:
    """When a solution is good enough, and how long to look for it.

    ``restarts`` are further starting points within the limits, a fixed sequence, tried one after
    the other when the first gets stuck. 0 keeps a motion on the branch of its seed.
    """

    tolerance_mm: float = 1e-7
    tolerance_rad: float = 1e-9
    max_iterations: int = 200
    restarts: int = 50

    def __post_init__(self) -> None:
        if not (self.tolerance_mm > 0.0 and self.tolerance_rad > 0.0):
            raise JointError(
                f"tolerances of inverse kinematics are {self.tolerance_mm} mm and "
                f"{self.tolerance_rad} rad: above 0 wanted"
            )
        if self.max_iterations < 1 or self.restarts < 0:
            raise JointError(
                f"inverse kinematics with {self.max_iterations} iterations and {self.restarts} "
                "restarts: at least 1 and 0 wanted"
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    positions: FloatArray
    matrices: FloatArray
    error: FloatArray

    @property
    def residual_mm(self) -> float:
        return float(np.linalg.norm(self.error[:3]))

    @property
    def residual_rad(self) -> float:
        return float(np.linalg.norm(self.error[3:])) / MM_PER_RAD

    @property
    def cost(self) -> float:
        return float(self.error @ self.error)

    def solves(self, options: IkOptions) -> bool:
        return (
            self.residual_mm <= options.tolerance_mm and self.residual_rad <= options.tolerance_rad
        )


class _Problem:
    """One link, one wanted pose, the actuated joints that move it."""

    def __init__(
        self, tree: KinematicTree, link: str, wanted: Transform, held: Mapping[str, float]
    ) -> None:
        names = dict.fromkeys(
            tree.driver_of(joint)[0] for joint in tree.path_to(link) if joint.moves
        )
        self.tree, self.link, self.wanted = tree, link, wanted
        self.drivers: Sequence[Joint] = [tree.joint(name) for name in names]
        self.names = list(names)
        self.held = {name: value for name, value in held.items() if name not in names}
        self.lower, self.upper = self._bounds()

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """The drivers' own limits, narrowed by those of the joints that follow them."""
        lower = np.array([joint.lower for joint in self.drivers])
        upper = np.array([joint.upper for joint in self.drivers])
        base = self.tree.all_positions(dict.fromkeys(self.names, 0.0))
        for joint in self.tree.path_to(self.link):
            if joint.mimic is None or not joint.moves:
                continue
            driver, gain = self.tree.driver_of(joint)
            if gain == 0.0:
                continue
            ends = sorted((end - base[joint.name]) / gain for end in (joint.lower, joint.upper))
            column = self.names.index(driver)
            lower[column] = max(lower[column], ends[0])
            upper[column] = min(upper[column], ends[1])
            if lower[column] > upper[column]:
                raise UnreachableError(
                    f"joint {driver!r} has no position within the limits of its follower "
                    f"{joint.name!r}"
                )
        return lower, upper

    def matrices(self, positions: FloatArray) -> FloatArray:
        given = {**self.held, **dict(zip(self.names, positions.tolist(), strict=True))}
        return self.tree.link_matrices(self.tree.all_positions(given))

    def attempt(self, positions: FloatArray) -> _Attempt:
        matrices = self.matrices(positions)
        reached = matrices[self.tree.link_rows[self.link]]
        turn = scipy.spatial.transform.Rotation.from_matrix(
            self.wanted.rotation @ reached[:3, :3].T
        ).as_rotvec()
        shift = self.wanted.translation_mm - reached[:3, 3]
        return _Attempt(positions, matrices, np.concatenate([shift, MM_PER_RAD * turn]))

    def starts(self, seed: Mapping[str, float], restarts: int) -> list[FloatArray]:
        """The seed (middle of the range where it says nothing), then an even, fixed spread."""
        low = np.where(np.isfinite(self.lower), self.lower, -math.pi)
        high = np.where(np.isfinite(self.upper), self.upper, math.pi)
        middle = 0.5 * (low + high)
        first = np.array(
            [seed.get(name, mid) for name, mid in zip(self.names, middle, strict=True)]
        )
        starts = [np.clip(first, self.lower, self.upper)]
        if restarts and self.names:
            from scipy.stats import qmc  # slow to load, and only restarts need it

            spread = qmc.Halton(len(self.names), scramble=False).random(restarts)
            starts.extend(low + (high - low) * spread)
        return starts

    def descend(self, start: FloatArray, options: IkOptions) -> _Attempt:
        """From one start to the nearest minimum of the error within the limits."""
        weights = np.repeat([1.0, MM_PER_RAD], 3)[:, None]
        best, damping = self.attempt(start), 1e-2
        for _ in range(options.max_iterations):
            if best.solves(options) or damping > 1e8:
                break
            jacobian = weights * self.tree.jacobian(self.link, self.names, best.matrices)
            gradient = jacobian.T @ best.error
            # A joint at a limit that it is pushed against takes no part in this step.
            stuck = ((best.positions <= self.lower) & (gradient < 0.0)) | (
                (best.positions >= self.upper) & (gradient > 0.0)
            )
            free = ~stuck
            if not free.any():
                break
            normal = jacobian[:, free].T @ jacobian[:, free]
            scale = np.diag(normal) + 1e-9 * max(float(np.trace(normal)), 1e-12)
            step = np.zeros(len(self.names))
            step[free] = np.linalg.solve(normal + damping * np.diag(scale), gradient[free])
            # Half a turn at most: beyond it the linear model says nothing.
            step *= min(1.0, math.pi / max(float(np.abs(step).max()), 1e-300))
            trial = self.attempt(np.clip(best.positions + step, self.lower, self.upper))
            if trial.cost < best.cost:
                stalled = trial.cost > (1.0 - STALL) * best.cost
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
    """Positions (rad, m) of all actuated joints that bring ``link`` to ``root_from_link``.

    Joints that do not move ``link`` keep their seed, or 0. The solution nearest to the seed's
    branch is found first; the result is the same for the same arguments. Raises
    `UnreachableError` with the smallest residual when no start leads to the pose.
    """
    actuated = [joint for joint in tree.joints if joint.moves and joint.mimic is None]
    known = {joint.name for joint in actuated}
    for name in seed:
        if tree.joint(name).name not in known:
            raise JointError(f"joint {name!r} follows another by mimic: seed its leader instead")
    held = tree.all_positions(seed)
    problem = _Problem(tree, link, root_from_link, {name: held[name] for name in known})
    first, *others = problem.starts(seed, options.restarts)
    best = problem.descend(first, options)
    for other in others:
        if best.solves(options):
            break
        best = min(best, problem.descend(other, options), key=lambda attempt: attempt.cost)
    if not best.solves(options):
        raise UnreachableError(
            f"link {link!r} cannot be brought to {root_from_link.translation_mm.round(3).tolist()} "
            f"mm within the joint limits: the nearest is {best.residual_mm:.3g} mm and "
            f"{best.residual_rad:.3g} rad away"
        )
    found = dict(zip(problem.names, best.positions.tolist(), strict=True))
    for joint in problem.drivers:
        if math.isinf(joint.lower) and not joint.slides:
            start = seed.get(joint.name, 0.0)
            found[joint.name] = start + math.remainder(found[joint.name] - start, math.tau)
    return {joint.name: found.get(joint.name, held[joint.name]) for joint in actuated}
