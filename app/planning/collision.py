"""Collision model of a robot among structures: which states and motions keep their clearances."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError, SurfaceMesh
from app.planning.collision_bodies import Body, arm, carried_bodies, link_bodies, packed, structure
from app.planning.collision_distance import find_nearer, new_scratch
from app.planning.collision_kernel import (
    FREE,
    INVALID,
    MAX_MM,
    MAX_POSITION,
    Pairs,
    blocking_pair,
)
from app.robot import Robot

SELF_CLEARANCE_MM = 0.1
"""Links that are nearer to each other than this touch."""

_RANDOM_STATES = 300
_SEED = 20240611


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that are nearer to each other than ``clearance_mm``; 0 mm if one is in the other.

    ``body`` is a link or a carried body, ``other`` a structure or another of these.
    """

    body: str
    other: str
    distance_mm: float
    clearance_mm: float

    def __str__(self) -> str:
        return (
            f"{self.body} is {self.distance_mm:.2f} mm from {self.other}; "
            f"expected at least {self.clearance_mm:g} mm"
        )


class CollisionModel:
    """Every link and carried body of a robot against every structure, and against each other.

    ``structures`` are closed surfaces in the root link's frame, by name. ``carried`` are bodies in
    the frame of the link that carries them. ``held`` are positions of the actuated joints that are
    not ``joints``; the states of the methods are positions (d,) of ``joints``.

    Structures are at least ``clearance_mm`` away, links and carried bodies do not touch each other
    (`SELF_CLEARANCE_MM`). Not tested are two that no joint of ``joints`` moves against each other,
    a link with the next link above it that has a surface, and two that touch in all of 300 random
    states: the rule of MoveIt's semantic robot descriptions.

    Not thread-safe. Methods raise `InputError` for a state that is not finite, beyond 1e6 rad or m,
    or that puts a link beyond 1e12 mm. Raises `InputError` for a clearance that is not finite and
    above 0, and for a robot with closed loops or without collision meshes, `MeshError` for a
    structure that is not closed, and `FrameError`.
    """

    def __init__(
        self,
        robot: Robot,
        joints: tuple[str, ...],
        held: Mapping[str, float],
        structures: Mapping[str, SurfaceMesh],
        *,
        clearance_mm: float,
        carried: Mapping[str, SurfaceMesh],
    ) -> None:
        if not 0.0 < clearance_mm < math.inf:
            raise InputError(f"clearance: is {clearance_mm} mm; expected a number above 0")
        self._robot, self.joints = robot, joints
        moving = [*link_bodies(robot), *carried_bodies(robot, carried)]
        moving.sort(key=lambda body: len(robot.tree.path_to(body.link)))  # upper links first
        fixed = [structure(robot, name, mesh) for name, mesh in structures.items()]
        self._bodies, self._first_structure = (*moving, *fixed), len(moving)
        names = [body.name for body in self._bodies]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"{twice!r}: names two bodies; expected different names")
        self._arrays = packed(self._bodies, robot.tree.link_rows)
        self._scratch = new_scratch(len(robot.tree.joints), len(self._bodies))
        self._nearest = (-1, -1)
        self._use_joints(robot.actuated_joint_names, {})
        pairs = self._not_always_touching(self._not_adjacent(moving))
        clearances = [SELF_CLEARANCE_MM] * len(pairs)
        for b in range(len(moving), len(self._bodies)):
            pairs += [(b, a) for a in range(len(moving))]
            clearances += [clearance_mm] * len(moving)
        self._use_joints(joints, held)
        kept = [k for k, (a, b) in enumerate(pairs) if self._movers(a) != self._movers(b)]
        self._pairs = self._pairs_of([pairs[k] for k in kept], [clearances[k] for k in kept])

    def contact_at(self, state: FloatArray) -> Contact | None:
        """The bodies that do not keep their clearance, or None. Tests containment too."""
        pair = self._blocking(self._pairs, state, state)
        if pair != FREE:
            a, b = self._pairs.bodies[pair].tolist()
            return self._contact(pair, self._distance_mm(a, b))
        for number, (a, b) in enumerate(self._pairs.bodies.tolist()):
            if self._is_inside(a, b) or self._is_inside(b, a):
                return self._contact(number, 0.0)
        return None

    @property
    def moving(self) -> tuple[Body, ...]:
        """Links with a collision mesh, and carried bodies."""
        return self._bodies[: self._first_structure]

    @property
    def structures(self) -> tuple[Body, ...]:
        """The structures, in the root link's frame."""
        return self._bodies[self._first_structure :]

    def distances_mm(self, state: FloatArray) -> FloatArray:
        """The distance (s,) of each structure from the nearest body; NaN if none is tested."""
        self._pose(state)
        found = np.full(len(self.structures), np.nan)
        for other, body in self._structure_pairs():
            number = other - self._first_structure
            below_mm = float(np.fmin(found[number], MAX_MM))
            found[number] = np.fmin(found[number], self._distance_mm(other, body, below_mm))
        return found

    def nearest_structure(self, state: FloatArray) -> tuple[str, float] | None:
        """The structure nearest to any body, and its distance in mm; None if none is tested.

        Fast for states that follow one another.
        """
        self._pose(state)
        pairs = self._structure_pairs()
        pairs.sort(key=lambda pair: pair != self._nearest)  # near again: no other one is searched
        below_mm = MAX_MM
        for pair in pairs:
            distance_mm = self._distance_mm(*pair, below_mm)
            if distance_mm < below_mm:
                below_mm, self._nearest = distance_mm, pair
        return (self._bodies[self._nearest[0]].name, below_mm) if below_mm < MAX_MM else None

    def _structure_pairs(self) -> list[tuple[int, int]]:
        """Tested pairs of a structure and a body."""
        return [(a, b) for a, b in self._pairs.bodies.tolist() if a >= self._first_structure]

    def _pose(self, state: FloatArray) -> None:
        """Compute the poses of all links."""
        self._blocking(self._pairs_of([], []), state, state)

    def motion_keeps_clearance(
        self, start: FloatArray, end: FloatArray, *, assumed_mm: float = 0.0
    ) -> bool:
        """True if all surfaces are far enough apart on the straight way.

        Then ``end`` is in nothing if ``start`` is. That is proven, unless with ``assumed_mm``: then
        parts of the motion in which no point moves that far are tested in their middle only, which
        is quicker.
        """
        return self._blocking(self._pairs, start, end, assumed_mm) == FREE

    def blocking_bodies(self, start: FloatArray, end: FloatArray) -> tuple[str, str] | None:
        """Two bodies that are not proven to keep their clearance on the straight way, or None."""
        pair = self._blocking(self._pairs, start, end)
        if pair == FREE:
            return None
        other, body = (self._bodies[k].name for k in self._pairs.bodies[pair].tolist())
        return body, other

    def _blocking(
        self, pairs: Pairs, start: FloatArray, end: FloatArray, assumed_mm: float = 0.0
    ) -> int:
        """Computes the poses of all links, too, as they are at ``end`` if ``start`` is that."""
        # Copies, since Numba compiles once more for arrays that are read-only.
        first, last = np.array([start, end])
        found = blocking_pair(
            self._arrays, pairs, self._arm, first, last, assumed_mm, self._scratch
        )
        if found == INVALID:
            raise InputError(
                f"joint positions: are {start.tolist()} to {end.tolist()}; expected finite numbers "
                f"within {MAX_POSITION:g} rad or m, and links within {MAX_MM:g} mm of the root"
            )
        return int(found)

    def _contact(self, pair: int, distance_mm: float) -> Contact:
        other, body = (self._bodies[k].name for k in self._pairs.bodies[pair].tolist())
        return Contact(body, other, distance_mm, float(self._pairs.clearance_mm[pair]))

    def _distance_mm(self, a: int, b: int, below_mm: float = MAX_MM) -> float:
        """The distance of two surfaces in the last state; inf from ``below_mm`` on."""
        return float(find_nearer(self._arrays, a, b, below_mm, 0, 0, True, self._scratch))

    def _is_inside(self, a: int, b: int) -> bool:
        """True if a part of body ``a`` is inside body ``b`` in the last state."""
        links = self._arrays.link
        f, g = self._scratch.matrices[links[a]], self._scratch.matrices[links[b]]
        points = self._bodies[a].part_points @ f[:3, :3].T + f[:3, 3] - g[:3, 3]
        return self._bodies[b].contains_any(points @ g[:3, :3])

    def _use_joints(self, joints: tuple[str, ...], held: Mapping[str, float]) -> None:
        self._arm = arm(self._robot, joints, held)

    def _not_adjacent(self, moving: list[Body]) -> list[tuple[int, int]]:
        """Pairs of ``moving``, without a link and the next one above it that has a surface."""
        with_surface = {body.link for body in moving}
        above = {}
        for link in with_surface:
            path = [self._robot.root_link, *(j.child for j in self._robot.tree.path_to(link))]
            above[link] = next((up for up in reversed(path[:-1]) if up in with_surface), None)
        return [
            (a, b)
            for b in range(len(moving))
            for a in range(b)
            if moving[b].name not in above or above[moving[b].name] != moving[a].name
        ]

    def _not_always_touching(self, pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """The pairs that are apart in one of many random states."""
        joints = [self._robot.tree.joint(name) for name in self._robot.actuated_joint_names]
        low = np.array([max(joint.lower, -np.pi) for joint in joints])
        high = np.array([min(joint.upper, np.pi) for joint in joints])
        apart: set[tuple[int, int]] = set()
        rng = np.random.default_rng(_SEED)
        for state in low + (high - low) * rng.random((_RANDOM_STATES, len(low))):
            self._pose(state)
            apart |= {
                pair for pair in set(pairs) - apart if self._distance_mm(*pair) >= SELF_CLEARANCE_MM
            }
            if len(apart) == len(pairs):
                break
        return sorted(apart)

    def _pairs_of(self, pairs: list[tuple[int, int]], clearances: list[float]) -> Pairs:
        joints = []
        for a, b in pairs:
            above_a, above_b = self._movers(a), self._movers(b)
            shared = len(set(above_a) & set(above_b))
            joints.append((len(above_a) - shared, len(above_b) - shared))
        return Pairs(
            np.array(pairs, np.int64).reshape(-1, 2),
            np.array(clearances, np.float64),
            np.array(joints, np.int64).reshape(-1, 2),
        )

    def _movers(self, body: int) -> list[str]:
        """The joints that are not held and move a body."""
        tree = self._robot.tree
        moving = {joint.name for k, joint in enumerate(tree.joints) if self._arm.driver[k] >= 0}
        path = tree.path_to(self._bodies[body].link)
        return [joint.name for joint in path if joint.name in moving]
