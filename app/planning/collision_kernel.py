"""Compiled proof that a motion of a robot keeps its clearances.

Continuous, by the bound of the motion and not by samples (Schwarzer, Saha and Latombe, Adaptive
dynamic collision checking, 2005): two bodies that are ``d`` apart in the middle of an interval stay
apart by the clearance if no point of either moves by more than ``d`` less the clearance along the
line between them. That way is bounded by the velocity in the middle and the largest acceleration.
An interval for which that does not hold is bisected, for the pairs of bodies that it leaves open.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.fixture.jit import compiled, inlined, kernel, renew_with
from app.fixture.vectors import (
    Vector,
    add,
    cross,
    length,
    rotate_inverse,
    row,
    scaled,
    sub,
)
from app.geometry import FloatArray
from app.planning import collision_distance
from app.planning.collision_distance import (
    MAX_INTERVALS,
    MAX_OPEN,
    Bodies,
    Scratch,
    find_nearer,
    moved_mm,
)
from app.robot import link_kernel
from app.robot.elements import MM_PER_M
from app.robot.link_kernel import compute_link_poses

FREE, INVALID = -1, -2

MAX_POSITION, MAX_MM = 1e6, 1e12
"""Joints beyond this, in rad or m, and links so far from the root: motion bounds overflow."""

RESOLUTION_MM = 0.01
"""An interval in which no point moves by this is not bisected: the motion is not proven free."""


class Pairs(NamedTuple):
    """Pairs (p, 2) of bodies, the clearance (p,) of each, and the joints (p, 2) between them.

    Those are numbers of joints that move the first body, and the second one, against the link above
    both, counted from the body. Of two bodies of one chain the first is the upper one: it has 0.
    """

    bodies: NDArray[np.int64]
    clearance_mm: FloatArray
    joints: NDArray[np.int64]


class Arm(NamedTuple):
    """Joints k of the links k + 1: the arrays of `compute_link_poses`, and the k-th position.

    That is ``base[k] + gain[k] * q[driver[k]]``. ``axes`` and ``pivots_mm`` (n, 3) are in the frame
    of the link.
    """

    slides: NDArray[np.bool_]
    origins: FloatArray
    motions: FloatArray
    parents: NDArray[np.int64]
    base: FloatArray
    driver: NDArray[np.int64]
    gain: FloatArray
    axes: FloatArray
    pivots_mm: FloatArray


@kernel
def _fill_twists(bodies: Bodies, arm: Arm, scratch: Scratch) -> None:
    """Write `Scratch.twists`, as the poses and steps in ``scratch`` are.

    A joint moves a point by at most its step times the distance from its axis, to which the joints
    between add what they move. The way of a point bends by half its largest acceleration, as the
    range is passed in unit time: the step squared times that distance, and twice the step times
    the longest way by the joints between.
    """
    matrices, twists = scratch.matrices, scratch.twists
    for body in range(len(bodies.link)):
        pose, at, n = matrices[bodies.link[body]], bodies.link[body], 0
        root = bodies.first[body, 1]
        center, radius = row(bodies.nodes, root), bodies.nodes[root, 3]
        turn, way, bend, longest = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0
        while at > 0:
            k = at - 1
            if arm.driver[k] >= 0:
                frame, step = matrices[at], scratch.steps[k]
                axis = rotate_inverse(pose, _turned(frame, row(arm.axes, k)))
                pivot = _turned(frame, row(arm.pivots_mm, k))
                pivot = add(pivot, (frame[0, 3], frame[1, 3], frame[2, 3]))
                pivot = rotate_inverse(pose, sub(pivot, (pose[0, 3], pose[1, 3], pose[2, 3])))
                size = abs(step)
                if arm.slides[k]:
                    way = add(way, scaled(MM_PER_M * step, axis))
                    longest += MM_PER_M * size
                else:
                    lever = length(cross(axis, sub(center, pivot))) + radius + longest
                    turn = add(turn, scaled(step, axis))
                    way = add(way, scaled(step, cross(pivot, axis)))
                    bend += size * longest + 0.5 * size * size * lever
                    longest += size * lever
                for i in range(3):
                    twists[body, n, i], twists[body, n, 3 + i] = turn[i], way[i]
                twists[body, n, 6], twists[body, n, 7] = bend, longest
                n += 1
            at = arm.parents[k]


@inlined
def _turned(pose: FloatArray, p: Vector) -> Vector:
    return (
        pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2],
        pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2],
        pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2],
    )


@kernel
def _set_range(bodies: Bodies, arm: Arm, scratch: Scratch) -> bool:
    """Compute poses and twists of the range ``middle`` and ``half`` in ``scratch``.

    False if a pose is not within `MAX_MM` of the root.
    """
    for k in range(len(arm.base)):
        scratch.positions[k], scratch.steps[k] = arm.base[k], 0.0
        driver = arm.driver[k]
        if driver >= 0:
            scratch.positions[k] += arm.gain[k] * scratch.middle[driver]
            scratch.steps[k] = arm.gain[k] * scratch.half[driver]
    compute_link_poses(
        scratch.positions, arm.slides, arm.origins, arm.motions, arm.parents, scratch.matrices
    )
    for pose in scratch.matrices:
        for i in range(3):
            for j in range(4):
                if not abs(pose[i, j]) <= MAX_MM:  # NaN, too
                    return False
    _fill_twists(bodies, arm, scratch)
    return True


@compiled(error_model="numpy", nogil=True)
def blocking_pair(
    bodies: Bodies,
    pairs: Pairs,
    arm: Arm,
    start: FloatArray,
    end: FloatArray,
    assumed_mm: float,
    scratch: Scratch,
) -> int:
    """`FREE` if the straight motion between joint positions keeps all clearances, or a pair.

    Of that pair the clearance is not kept, or could not be proven. ``start`` and ``end`` (d,) may
    be equal. `INVALID` if one is not finite, beyond `MAX_POSITION`, or puts a link beyond `MAX_MM`.
    Containment is not tested: a motion that begins outside of a body stays outside.
    An interval in which no point moves by ``assumed_mm`` is only tested in its middle: 0 proves.
    """
    count = len(pairs.clearance_mm)
    # The end alone comes first: most motions that are not free end in a collision.
    scratch.ends[0, 0], scratch.ends[0, 1] = 1.0, 1.0
    scratch.ends[1, 0], scratch.ends[1, 1] = 0.0, 1.0
    for number in range(2):
        scratch.lists[number, 0], scratch.lists[number, 1] = 0, count
    for number in range(count):
        scratch.open[number] = number
    used, head, tail = count, 0, 1
    for joint in range(len(start)):
        if not (abs(start[joint]) <= MAX_POSITION and abs(end[joint]) <= MAX_POSITION):  # NaN, too
            return INVALID
        if start[joint] != end[joint]:
            tail = 2
    while head < tail:
        low, high = scratch.ends[head, 0], scratch.ends[head, 1]
        middle = 0.5 * (low + high)
        for joint in range(len(start)):
            change = end[joint] - start[joint]
            scratch.middle[joint] = start[joint] + middle * change
            scratch.half[joint] = 0.5 * (high - low) * change
        if not _set_range(bodies, arm, scratch):
            return INVALID
        begin = used
        for at in range(scratch.lists[head, 0], scratch.lists[head, 1]):
            pair = int(scratch.open[at])
            a, b, clearance = pairs.bodies[pair, 0], pairs.bodies[pair, 1], pairs.clearance_mm[pair]
            by_a, by_b = pairs.joints[pair, 0], pairs.joints[pair, 1]
            moved = moved_mm(scratch.twists, a, by_a, bodies.nodes, bodies.first[a, 1])
            moved += moved_mm(scratch.twists, b, by_b, bodies.nodes, bodies.first[b, 1])
            if not moved <= MAX_MM:  # NaN, too
                return pair
            if moved < assumed_mm:
                by_a, by_b = 0, 0  # as if nothing moved
            distance = find_nearer(bodies, a, b, clearance, by_a, by_b, False, scratch)
            if distance < clearance:
                return pair
            if distance < math.inf:
                if moved < RESOLUTION_MM or used == MAX_OPEN:
                    return pair
                scratch.open[used] = pair
                used += 1
        if used > begin:
            if tail + 2 > MAX_INTERVALS:
                return int(scratch.open[begin])
            for side in range(2):
                scratch.ends[tail, 0] = low if side == 0 else middle
                scratch.ends[tail, 1] = middle if side == 0 else high
                scratch.lists[tail, 0], scratch.lists[tail, 1] = begin, used
                tail += 1
        head += 1
    return FREE


renew_with(blocking_pair, link_kernel.__file__, collision_distance.__file__)
