"""Signed distance of straight needles to a closed surface (compiled).

The axis of a needle is a segment. Outside of the surface the distance is exact; where the axis
enters, it is that of the deepest point of the axis within a tolerance. All kernels are in
this file, because the cache of the compiler is valid until this file or `app.fixture` changes.
"""

import math

import numpy as np
from numba import prange

from app.fixture.jit import inlined, kernel, parallel
from app.fixture.meshes.mesh_checks import checked_mesh
from app.fixture.surfaces.box_bounds import box_to_point_squared, interval_gap, project_on_axis
from app.fixture.surfaces.closest_point import signed_closest_point
from app.fixture.surfaces.surface import Surface, surface_of_bvh
from app.fixture.surfaces.traversal import Stack, corners_of, leaf_range
from app.fixture.surfaces.triangles import (
    closest_of_segments,
    closest_on_triangle,
    intersect_segment_triangle,
)
from app.fixture.vectors import Vector, add_scaled, dot, point_distance, row, squared_distance, sub
from app.geometry import FloatArray, SurfaceMesh

DEPTH_TOLERANCE_MM = 0.05
"""Largest error of a negative distance, unless another is given."""

_TOUCHING_MM = 1e-9
"""An axis nearer to the surface than this meets it: rounding may miss the edge of a triangle."""

_BLOCK = 256
"""Needles that follow each other begin their search at the triangle that the last one found."""


def closed_surface(mesh: SurfaceMesh, what: str) -> Surface:
    """Prepare ``mesh`` for `needle_distances`; raises `MeshError` if it bounds no solid."""
    checked = checked_mesh(mesh, what)
    return surface_of_bvh(checked.bvh, checked.twin)


def needle_distances(
    surface: Surface,
    starts_mm: FloatArray,
    ends_mm: FloatArray,
    limit_mm: float | FloatArray = math.inf,
    tolerance_mm: float = DEPTH_TOLERANCE_MM,
) -> FloatArray:
    """Signed distance (n,) of the axes from ``starts_mm`` to ``ends_mm``, (n, 3) each.

    A distance above ``limit_mm`` (a number or (n,)) is given as that limit, which is faster. A
    negative one is above the true one by at most ``tolerance_mm``; infinite: 0 or an end of
    the axis, without a search.
    """
    # Writable copies: compiled code is specialised on whether an array is writable.
    shape = np.broadcast_shapes(np.shape(starts_mm), np.shape(ends_mm))
    starts, ends = (
        np.array(np.broadcast_to(each, shape), dtype=np.float64, order="C")
        for each in (starts_mm, ends_mm)
    )
    limits = np.array(np.broadcast_to(limit_mm, len(starts)), dtype=np.float64)
    found = np.empty(len(starts))
    _needle_distances(surface, starts, ends, limits, tolerance_mm, found)
    return found


@parallel
def _needle_distances(
    surface: Surface,
    starts: FloatArray,
    ends: FloatArray,
    limits: FloatArray,
    tolerance: float,
    found: FloatArray,
) -> None:
    count = len(starts)
    for block in prange((count + _BLOCK - 1) // _BLOCK):
        stack = Stack(np.empty(64, dtype=np.int64), np.empty(64))
        intervals = np.empty((64, 4))
        begin = int(np.int64(block)) * _BLOCK
        near = 0
        for i in range(begin, min(begin + _BLOCK, count)):
            p, q = row(starts, i), row(ends, i)
            distance, near = _distance_to_surface(surface, p, q, limits[i], near, stack)
            if distance <= _TOUCHING_MM or _is_inside(surface, q, near, stack):
                distance = _deepest(surface, p, q, near, tolerance, stack, intervals)
            found[i] = distance


@kernel
def _distance_to_surface(
    surface: Surface, p: Vector, q: Vector, limit: float, start: int, stack: Stack
) -> tuple[float, int]:
    """Distance of the segment ``pq`` to the triangles, at most ``limit``, and a near triangle.

    The distance is 0 where they intersect. ``start`` is a triangle that is likely near.
    """
    best, triangle = limit * limit, start
    bound = _box_bound_squared(surface.boxes, 0, p, q)
    if bound >= best:
        return limit, start
    best = min(best, _to_triangle_squared(surface, start, p, q, best))
    first_leaf = (1 << surface.levels) - 1
    top = 0
    stack.nodes[0], stack.bounds[0] = 0, bound
    while top >= 0 and best > 0.0:
        node, bound = stack.nodes[top], stack.bounds[top]
        top -= 1
        if bound >= best:
            continue
        if node >= first_leaf:
            begin, end = leaf_range(surface, node)
            for i in range(begin, end):
                squared = _to_triangle_squared(surface, i, p, q, best)
                if squared < best:
                    best, triangle = squared, i
            continue
        near, far = 2 * node + 1, 2 * node + 2
        to_near = _box_bound_squared(surface.boxes, near, p, q)
        to_far = _box_bound_squared(surface.boxes, far, p, q)
        if to_far < to_near:
            near, far, to_near, to_far = far, near, to_far, to_near
        if to_far < best:
            top += 1
            stack.nodes[top], stack.bounds[top] = far, to_far
        if to_near < best:
            top += 1
            stack.nodes[top], stack.bounds[top] = near, to_near
    return math.sqrt(best), triangle


@kernel
def _to_triangle_squared(surface: Surface, i: int, p: Vector, q: Vector, best: float) -> float:
    """Squared distance of the segment ``pq`` to triangle ``i``; ``best`` if it is not lower."""
    a, b, c = corners_of(surface, i)
    n = surface.normals[i, 6]
    normal = (float(n[0]), float(n[1]), float(n[2]))
    at_p, at_q = dot(normal, sub(p, a)), dot(normal, sub(q, a))
    if at_p * at_q > 0.0:
        # The normal has single precision: the plane may be nearer than this by a little.
        above = min(abs(at_p), abs(at_q)) * (1.0 - 1e-6) - 1e-5 * _reach(p, q, a)
        if above > 0.0 and above * above >= best:
            return best
    elif intersect_segment_triangle(p, q, a, b, c)[0]:
        return 0.0
    x, _ = closest_on_triangle(p, a, b, c)
    best = min(best, squared_distance(p, x))
    x, _ = closest_on_triangle(q, a, b, c)
    best = min(best, squared_distance(q, x))
    for u, v in ((a, b), (b, c), (c, a)):
        x, y = closest_of_segments(p, q, u, v)
        best = min(best, squared_distance(x, y))
    return best


@inlined
def _reach(p: Vector, q: Vector, a: Vector) -> float:
    return point_distance(p, a) + point_distance(q, a)


@kernel
def _box_bound_squared(boxes: FloatArray, node: int, p: Vector, q: Vector) -> float:
    """Lower bound of the squared distance between a box and the segment ``pq``.

    The larger one of two: the distance to the box of the segment along the same axes, which is
    tight for a segment far away, and that to the plane through the segment's point nearest to the
    centre of the box, perpendicular to the line between the two, which is tight for a small box.
    """
    pq = sub(q, p)
    along, length_squared, apart = 0.0, dot(pq, pq), 0.0
    gap_squared = 0.0
    for axis in range(3):
        at_p, at_q = project_on_axis(boxes, node, axis, p), project_on_axis(boxes, node, axis, q)
        low, high = boxes[node, 9 + axis], boxes[node, 12 + axis]
        gap = interval_gap(low, high, min(at_p, at_q), max(at_p, at_q))
        gap_squared += gap * gap
        along += (0.5 * (low + high) - at_p) * (at_q - at_p)
    part = min(max(along / length_squared, 0.0), 1.0) if length_squared > 0.0 else 0.0
    squared, extent = 0.0, 0.0
    for axis in range(3):
        at_p, at_q = project_on_axis(boxes, node, axis, p), project_on_axis(boxes, node, axis, q)
        low, high = boxes[node, 9 + axis], boxes[node, 12 + axis]
        apart = abs(0.5 * (low + high) - (at_p + part * (at_q - at_p)))
        squared += apart * apart
        extent += 0.5 * (high - low) * apart
    if extent >= squared:
        return gap_squared
    return max(gap_squared, (squared - extent) * (squared - extent) / squared)


@kernel
def _is_inside(surface: Surface, q: Vector, near: int, stack: Stack) -> bool:
    """True if ``q`` is inside."""
    if box_to_point_squared(surface.boxes, 0, q) > 0.0:
        return False
    return signed_closest_point(surface, q, near, stack)[0] < 0.0


@kernel
def _deepest(
    surface: Surface,
    p: Vector,
    q: Vector,
    near: int,
    tolerance: float,
    stack: Stack,
    intervals: FloatArray,
) -> float:
    """Lowest signed distance of the points of ``pq``, which meets the surface or is inside.

    Branch and bound: a signed distance changes by at most the distance between two points
    (Piyavskii 1972). At most 0.
    """
    length = point_distance(p, q)
    at_p, near, _ = signed_closest_point(surface, p, near, stack)
    at_q, near, _ = signed_closest_point(surface, q, near, stack)
    best = min(at_p, at_q, 0.0)
    intervals[0, 0], intervals[0, 1], intervals[0, 2], intervals[0, 3] = 0.0, length, at_p, at_q
    top = 0
    while top >= 0:
        begin, end, at_begin, at_end = (
            intervals[top, 0],
            intervals[top, 1],
            intervals[top, 2],
            intervals[top, 3],
        )
        top -= 1
        if 0.5 * (at_begin + at_end - (end - begin)) >= best - tolerance:
            continue
        middle = 0.5 * (begin + end + at_begin - at_end)
        x = add_scaled(p, middle / length, sub(q, p))
        there, near, _ = signed_closest_point(surface, x, near, stack)
        best = min(best, there)
        # The half with the lower end is searched first.
        for first in (at_begin > at_end, at_begin <= at_end):
            top += 1
            if first:
                intervals[top, 0], intervals[top, 1] = begin, middle
                intervals[top, 2], intervals[top, 3] = at_begin, there
            else:
                intervals[top, 0], intervals[top, 1] = middle, end
                intervals[top, 2], intervals[top, 3] = there, at_end
    return best
