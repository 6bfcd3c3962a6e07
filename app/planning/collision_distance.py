"""Distance of two bodies of triangles, as far as a motion can bring them together (compiled).

Branch and bound over two trees of boxes. The bodies' own motion is bounded for each pair of nodes:
points near the axis of a joint move little.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.fixture.jit import inlined, kernel
from app.fixture.surfaces.triangles import closest_of_triangles
from app.fixture.vectors import (
    Vector,
    add,
    cross,
    dot,
    length,
    rotate_inverse,
    row,
    scaled,
    sub,
)
from app.geometry import FloatArray

MAX_INTERVALS, MAX_OPEN = 1 << 14, 1 << 18
"""A motion that needs more intervals, or more pairs in them, is not proven free."""

_STACK = 256

_VISITS, _LARGE_MM = 8, 50.0
"""After so many pairs of nodes a motion by more than this is not proven: two halves are quicker."""

_PLANES = 12
"""Planes between convex hulls that are tried."""


Between: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""Rows of the rotation of a second body into the frame of a first one, and its place there."""

Motion: TypeAlias = tuple[Vector, Vector, float, float]
"""Turn, way of the origin, bend and longest way of a body, as in `Scratch.twists`."""


class Bodies(NamedTuple):
    """Triangles of all bodies, and a tree of boxes and spheres over those of each.

    ``corners`` (m, 3, 3), ``spheres`` (m, 4), centre and radius, and unit ``normals`` (m, 3) are
    those of triangles in the frame of their link. ``nodes`` (n, 16) are those of a `Bvh`: centre
    and radius of a sphere, three unit axes, half the extent along each. ``first`` (b, 2) are the
    first triangle and the first node of a body, ``size`` and ``levels`` (b,) its triangles and
    levels, ``link`` (b,) the row of the link that carries it. The corners of the convex hull of a
    body are those of ``hulls`` (h, 3) from ``hull_first`` (b + 1,) to the next.
    """

    corners: FloatArray
    spheres: FloatArray
    normals: FloatArray
    nodes: FloatArray
    first: NDArray[np.int64]
    size: NDArray[np.int64]
    levels: NDArray[np.int64]
    link: NDArray[np.int64]
    hulls: FloatArray
    hull_first: NDArray[np.int64]


class Scratch(NamedTuple):
    """Memory of one search at a time.

    ``middle`` and ``half`` (n,) are the middle of a straight motion in joint space and half its
    steps, ``positions`` and ``steps`` (n,) those of every joint k, ``matrices`` the links' poses.
    ``twists`` (b, n, 8) are the motion of each body by its first, its first two, ... joints, from
    the body on, by half the steps, in the frame of its link: turn in rad and way of the origin in
    mm by the velocity in the middle; bounds of how far points go off that way, and of all ways.
    """

    middle: FloatArray
    half: FloatArray
    positions: FloatArray
    steps: FloatArray
    matrices: FloatArray
    twists: FloatArray
    ends: FloatArray
    lists: NDArray[np.int64]
    open: NDArray[np.int64]
    stack: NDArray[np.int64]
    bounds: FloatArray


def new_scratch(joints: int, bodies: int) -> Scratch:
    """Allocate the memory for a robot of so many joints and bodies."""
    return Scratch(
        np.empty(joints),
        np.empty(joints),
        np.empty(joints),
        np.empty(joints),
        np.empty((joints + 1, 4, 4)),
        np.zeros((bodies, joints, 8)),
        np.empty((MAX_INTERVALS, 2)),
        np.empty((MAX_INTERVALS, 2), np.int64),
        np.empty(MAX_OPEN, np.int64),
        np.empty((_STACK, 2), np.int64),
        np.empty(_STACK),
    )


@kernel
def moved_mm(twists: FloatArray, body: int, joints: int, spheres: FloatArray, i: int) -> float:
    """The longest way of any point of a sphere of ``body`` against the link above so many joints.

    That is its way by the velocity in the middle, and what all others can add (`Scratch.twists`).
    """
    if joints == 0:
        return 0.0
    n = joints - 1
    turn = (twists[body, n, 0], twists[body, n, 1], twists[body, n, 2])
    way = (twists[body, n, 3], twists[body, n, 4], twists[body, n, 5])
    way = add(way, cross(turn, row(spheres, i)))
    straight = length(way) + spheres[i, 3] * length(turn)
    return float(min(straight + twists[body, n, 6], twists[body, n, 7]))


@inlined
def _moved_along(n: Vector, go: Vector, radius: float, motion: Motion) -> float:
    """The longest way along the unit vector ``n`` of a sphere whose centre goes by ``go``."""
    turn, _, bend, longest = motion
    return min(abs(dot(n, go)) + radius * length(cross(n, turn)) + bend, longest)


@inlined
def _turned(between: Between, v: Vector) -> Vector:
    """The direction ``v`` of the second body in the frame of the first."""
    return (dot(between[0], v), dot(between[1], v), dot(between[2], v))


@inlined
def _placed(between: Between, p: Vector) -> Vector:
    """The point ``p`` of the second body in the frame of the first."""
    return add(between[3], _turned(between, p))


@kernel
def _box_gap(
    nodes: FloatArray, i: int, j: int, between: Between, motion: Motion, below: float
) -> float:
    """A lower bound of the distance of the nodes ``i`` and ``j``; at once if it is not ``below``.

    The second is at ``between``, and moves by ``motion`` in the frame of the first.
    """
    center = _placed(between, row(nodes, j))
    to, go, radius = sub(center, row(nodes, i)), (0.0, 0.0, 0.0), nodes[j, 3]
    apart = math.sqrt(dot(to, to))
    gap = float(apart - nodes[i, 3] - radius)
    if gap >= below + motion[3]:
        return gap - motion[3]
    moves = motion[3] > 0.0
    if moves:
        go = add(motion[1], cross(motion[0], center))
        if gap > 0.0:
            gap -= _moved_along(scaled(1.0 / apart, to), go, radius, motion)
            if gap >= below:
                return gap
    a = _turned(between, (nodes[j, 4], nodes[j, 5], nodes[j, 6]))
    b = _turned(between, (nodes[j, 7], nodes[j, 8], nodes[j, 9]))
    c = _turned(between, (nodes[j, 10], nodes[j, 11], nodes[j, 12]))
    along_a, along_b, along_c = abs(dot(a, to)), abs(dot(b, to)), abs(dot(c, to))
    first = 0.0
    for k in range(3):
        u = (nodes[i, 4 + 3 * k], nodes[i, 5 + 3 * k], nodes[i, 6 + 3 * k])
        by_a, by_b, by_c = abs(dot(u, a)), abs(dot(u, b)), abs(dot(u, c))
        half = nodes[i, 13 + k]
        along_a, along_b, along_c = (
            along_a - by_a * half,
            along_b - by_b * half,
            along_c - by_c * half,
        )
        along = (
            abs(dot(u, to)) - half - by_a * nodes[j, 13] - by_b * nodes[j, 14] - by_c * nodes[j, 15]
        )
        if along > 0.0 and moves:
            along -= _moved_along(u, go, radius, motion)
        if along > 0.0:
            first += along * along
    second = 0.0
    for n, along in (
        (a, along_a - nodes[j, 13]),
        (b, along_b - nodes[j, 14]),
        (c, along_c - nodes[j, 15]),
    ):
        left = along - _moved_along(n, go, radius, motion) if along > 0.0 and moves else along
        if left > 0.0:
            second += left * left
    if first == 0.0 and second == 0.0:
        return gap  # below 0 for boxes that overlap: the deeper, the sooner visited
    return max(gap, math.sqrt(max(first, second)))


@inlined
def _corner(corners: FloatArray, i: int, k: int) -> Vector:
    return (corners[i, k, 0], corners[i, k, 1], corners[i, k, 2])


@inlined
def _plane_gap(n: Vector, p: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """The distance of the triangle ``abc`` from the plane through ``p``; 0 if it crosses it."""
    x, y, z = dot(n, sub(a, p)), dot(n, sub(b, p)), dot(n, sub(c, p))
    return max(min(x, y, z), -max(x, y, z), 0.0)


@kernel
def _are_apart(
    bodies: Bodies, a: int, b: int, between: Between, motion: Motion, gap: float
) -> bool:
    """True if a plane has the hulls of the bodies on its two sides, ``gap`` mm apart all the way.

    Place and motion of the second are those of `_box_gap`. By the descent of Gilbert
    (1966) to the nearest point ``v`` of the difference of the hulls, with the corners of the second
    at both ends of their straight way, and its bend as a gap.
    """
    hulls, first, turn = bodies.hulls, bodies.hull_first, motion[0]
    gap += motion[2]
    v = _placed(between, row(bodies.nodes, bodies.first[b, 1]))
    v = sub(v, row(bodies.nodes, bodies.first[a, 1]))
    for _ in range(_PLANES):
        size = length(v)
        if not size > gap:
            return False
        n = scaled(1.0 / size, v)
        high, i = -math.inf, first[a]
        for k in range(first[a], first[a + 1]):
            at = n[0] * hulls[k, 0] + n[1] * hulls[k, 1] + n[2] * hulls[k, 2]
            if not at <= high:  # NaN, too: proves nothing
                high, i = at, k
        # The place of a corner along the plane's normal, and its way: linear in the corner.
        place, way = _turned_back(between, n), cross(n, turn)
        along = dot(way, between[3]) + dot(n, motion[1])
        way = _turned_back(between, way)
        low, j = math.inf, first[b]
        for k in range(first[b], first[b + 1]):
            go = along + way[0] * hulls[k, 0] + way[1] * hulls[k, 1] + way[2] * hulls[k, 2]
            at = place[0] * hulls[k, 0] + place[1] * hulls[k, 1] + place[2] * hulls[k, 2] - abs(go)
            if not at >= low:
                low, j = at, k
        if low + dot(n, between[3]) - high >= gap:
            return True
        corner = _placed(between, row(hulls, j))
        nearer = add(motion[1], cross(turn, corner))
        corner = sub(corner, scaled(math.copysign(1.0, dot(n, nearer)), nearer))
        change = sub(sub(corner, row(hulls, i)), v)
        part = -dot(v, change) / max(dot(change, change), 1e-12)
        v = add(v, scaled(min(max(part, 0.0), 1.0), change))
    return False


@inlined
def _turned_back(between: Between, v: Vector) -> Vector:
    """The inverse of `_turned`."""
    turned = add(scaled(v[0], between[0]), scaled(v[1], between[1]))
    return add(turned, scaled(v[2], between[2]))


@kernel
def find_nearer(
    bodies: Bodies,
    a: int,
    b: int,
    clearance: float,
    joints_a: int,
    joints_b: int,
    exact: bool,
    scratch: Scratch,
) -> float:
    """A distance of the bodies ``a`` and ``b`` that the motion can bring below ``clearance``.

    Inf if there is none; less than ``clearance`` only if there is one now. Another number only says
    that the motion is not proven free. ``exact``: the distance itself if it is below ``clearance``,
    0 where surfaces intersect.
    """
    matrices, twists = scratch.matrices, scratch.twists
    stack, bounds = scratch.stack, scratch.bounds
    f, g = matrices[bodies.link[a]], matrices[bodies.link[b]]
    to = (g[0, 3] - f[0, 3], g[1, 3] - f[1, 3], g[2, 3] - f[2, 3])
    between = (
        rotate_inverse(g, (f[0, 0], f[1, 0], f[2, 0])),
        rotate_inverse(g, (f[0, 1], f[1, 1], f[2, 1])),
        rotate_inverse(g, (f[0, 2], f[1, 2], f[2, 2])),
        rotate_inverse(f, to),
    )
    nodes, corners, spheres, normals = bodies.nodes, bodies.corners, bodies.spheres, bodies.normals
    first_a, first_b = bodies.first[a, 1], bodies.first[b, 1]
    leaf_a, leaf_b = (1 << bodies.levels[a]) - 1, (1 << bodies.levels[b]) - 1
    found, of_a = math.inf, moved_mm(twists, a, joints_a, nodes, first_a)
    slack = of_a + moved_mm(twists, b, joints_b, nodes, first_b)
    still = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)
    motion = still
    if slack > of_a:
        last = twists[b, joints_b - 1]
        turn = _turned(between, (last[0], last[1], last[2]))
        way = sub(_turned(between, (last[3], last[4], last[5])), cross(turn, between[3]))
        motion = (turn, way, last[6], last[7])
    if slack > 0.0 and not exact:
        # One pair of triangles often shows at once that the motion is not proven free.
        m, n = bodies.first[a, 0] + bodies.size[a] // 2, bodies.first[b, 0] + bodies.size[b] // 2
        center = _placed(between, row(spheres, n))
        apart = sub(center, row(spheres, m))
        distance = length(apart)
        go = add(motion[1], cross(motion[0], center))
        moved = of_a + _moved_along(scaled(1.0 / max(distance, 1e-9), apart), go, 0.0, motion)
        if distance < clearance + moved:
            found, slack, of_a, motion = distance, 0.0, 0.0, still
            if distance < clearance:
                return found
    stack[0, 0], stack[0, 1], top = 0, 0, 0
    bounds[0] = _box_gap(nodes, first_a, first_b, between, motion, clearance + of_a)
    visits = 0
    while top >= 0:
        i, j, bound = stack[top, 0], stack[top, 1], bounds[top]
        top -= 1
        visits += 1
        if visits == _VISITS and not exact:
            if _are_apart(bodies, a, b, between, motion, clearance + of_a):
                return found
            if slack > _LARGE_MM:
                # From now on only a collision now is of interest.
                found, slack, of_a, motion = clearance + slack, 0.0, 0.0, still
                if _are_apart(bodies, a, b, between, motion, clearance):
                    return found
        if bound >= clearance + of_a:
            continue
        if i < leaf_a or j < leaf_b:
            by_a = j >= leaf_b or (i < leaf_a and nodes[first_a + i, 3] >= nodes[first_b + j, 3])
            near = (2 * i + 1, j) if by_a else (i, 2 * j + 1)
            far = (2 * i + 2, j) if by_a else (i, 2 * j + 2)
            below = clearance + of_a
            to_near = _box_gap(nodes, first_a + near[0], first_b + near[1], between, motion, below)
            to_far = _box_gap(nodes, first_a + far[0], first_b + far[1], between, motion, below)
            if to_far < to_near:
                near, far, to_near, to_far = far, near, to_far, to_near
            if to_far < below:
                top += 1
                stack[top, 0], stack[top, 1], bounds[top] = far[0], far[1], to_far
            if to_near < below:
                top += 1
                stack[top, 0], stack[top, 1], bounds[top] = near[0], near[1], to_near
            continue
        i, j = i - leaf_a, j - leaf_b
        count, level, offset = bodies.size[a], bodies.levels[a], bodies.first[a, 0]
        from_a, to_a = offset + ((i * count) >> level), offset + (((i + 1) * count) >> level)
        count, level, offset = bodies.size[b], bodies.levels[b], bodies.first[b, 0]
        from_b, to_b = offset + ((j * count) >> level), offset + (((j + 1) * count) >> level)
        for n in range(from_b, to_b):
            center = _placed(between, row(spheres, n))
            normal = _turned(between, row(normals, n))
            d = _placed(between, _corner(corners, n, 0))
            e = _placed(between, _corner(corners, n, 1))
            h = _placed(between, _corner(corners, n, 2))
            go, radius = add(motion[1], cross(motion[0], center)), spheres[n, 3]
            for m in range(from_a, to_a):
                least, apart = clearance + of_a, sub(center, row(spheres, m))
                reach = least + motion[3] + spheres[m, 3] + radius
                if dot(apart, apart) >= reach * reach:
                    continue
                u, v, w = _corner(corners, m, 0), _corner(corners, m, 1), _corner(corners, m, 2)
                side = row(normals, m)
                gap = _plane_gap(side, u, d, e, h)
                if gap >= least and gap >= least + _moved_along(side, go, radius, motion):
                    continue
                gap = _plane_gap(normal, d, u, v, w)
                if gap >= least and gap >= least + _moved_along(normal, go, radius, motion):
                    continue
                distance, p, q = closest_of_triangles(u, v, w, d, e, h)
                if distance >= least:
                    if motion[3] == 0.0:
                        continue
                    # Only what moves along the line between them brings them together. Of slivers
                    # the line is inexact: the distance along it is that of the corners.
                    line = scaled(1.0 / max(distance, 1e-9), sub(q, p))
                    gap = min(dot(line, d), dot(line, e), dot(line, h))
                    gap -= max(dot(line, u), dot(line, v), dot(line, w))
                    if gap >= least + _moved_along(line, go, radius, motion):
                        continue
                found = distance
                if exact and distance > 0.0:
                    clearance = distance
                elif distance < clearance:
                    return found
                else:
                    slack, of_a, motion = 0.0, 0.0, still
    return found
