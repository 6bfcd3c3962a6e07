"""Compiled forward kinematics and Jacobian, because they run at every step of a session.

And the descent of inverse kinematics, which runs at every set point of a simulated arm.

A module of its own, so that the compiler is loaded only when a link pose is computed.
"""

import math

import numpy as np
from numba import njit
from numba.core.runtime.nrt import rtsys
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations

_Ints = NDArray[np.int64]
_Tree = tuple[NDArray[np.bool_], FloatArray, FloatArray, _Ints]
_Link = tuple[int, _Ints, _Ints, NDArray[np.bool_], FloatArray, FloatArray, FloatArray]


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def compute_link_poses(
    positions: FloatArray,
    slides: NDArray[np.bool_],
    origins: FloatArray,
    motions: FloatArray,
    parents: NDArray[np.int64],
    matrices: FloatArray,
) -> bool:
    """Write ``root_from_link`` to ``matrices`` (n + 1, 4, 4); return True if all are finite.

    The n joints are ordered from root to leaves; joint k moves link k + 1. ``positions`` (n,) are
    in rad, or in m where ``slides`` (n,), and 0 for fixed joints. ``parents`` (n,) are indices of
    links. ``origins`` (n, 4, 4) are at position 0. ``motions`` (2, n, 4, 4) are the origins times
    T and times T^2 of `Joint.twist`.
    """
    for i in range(4):
        for j in range(4):
            matrices[0, i, j] = 1.0 if i == j else 0.0
    is_finite = True
    for k in range(len(positions)):
        position = positions[k]
        once = position if slides[k] else math.sin(position)
        twice = 0.0 if slides[k] else 1.0 - math.cos(position)
        parent, link = matrices[parents[k]], matrices[k + 1]
        for j in range(4):
            x = origins[k, 0, j] + once * motions[0, k, 0, j] + twice * motions[1, k, 0, j]
            y = origins[k, 1, j] + once * motions[0, k, 1, j] + twice * motions[1, k, 1, j]
            z = origins[k, 2, j] + once * motions[0, k, 2, j] + twice * motions[1, k, 2, j]
            for i in range(3):
                link[i, j] = parent[i, 0] * x + parent[i, 1] * y + parent[i, 2] * z
            link[3, j] = 0.0
        for i in range(4):
            link[i, 3] += parent[i, 3]
            is_finite &= math.isfinite(link[i, 3])
    return is_finite


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def compute_jacobian(
    matrices: FloatArray,
    origin_row: int,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    slides: NDArray[np.bool_],
    gains: FloatArray,
    axes: FloatArray,
    pivots_mm: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Add the motion of the link ``origin_row`` to ``jacobian`` (6, n), in mm and rad.

    ``matrices`` are those of `compute_link_poses`. For each of m joints: the row of its child link,
    the column of its driver, the gain to it (in mm for one that ``slides``), axis and pivot (3,) in
    the child's frame.
    """
    for k in range(len(rows)):
        child, column, gain = matrices[rows[k]], columns[k], gains[k]
        turn, lever = np.empty(3), np.empty(3)
        for i in range(3):
            turn[i] = gain * (
                child[i, 0] * axes[k, 0] + child[i, 1] * axes[k, 1] + child[i, 2] * axes[k, 2]
            )
            pivot = (
                child[i, 0] * pivots_mm[k, 0]
                + child[i, 1] * pivots_mm[k, 1]
                + child[i, 2] * pivots_mm[k, 2]
            )
            lever[i] = matrices[origin_row, i, 3] - (pivot + child[i, 3])
        for i in range(3):
            if slides[k]:
                jacobian[i, column] += turn[i]
            else:
                after, before = (i + 1) % 3, (i + 2) % 3
                jacobian[i, column] += turn[after] * lever[before] - turn[before] * lever[after]
                jacobian[3 + i, column] += turn[i]


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def descend(
    start: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    goal: FloatArray,
    base: FloatArray,
    drivers: NDArray[np.int64],
    driver_gains: FloatArray,
    tree: _Tree,
    link: _Link,
    weight: float,
    tolerance_mm: float,
    tolerance_rad: float,
    max_iterations: int,
    min_cost_drop: float,
    best: FloatArray,
    error: FloatArray,
) -> bool:
    """Descend as `app.robot.inverse_kinematics`; write ``best`` (n,) and its ``error`` (6,).

    ``start``, ``lower`` and ``upper`` (n,) are of the drivers, ``goal`` (4, 4) is the pose.
    Position k of m joints is ``base[k]``, plus ``driver_gains[k]`` times the driver
    ``drivers[k]`` where that is not negative. ``tree`` are the arguments of `compute_link_poses`
    after the positions, ``link`` those of `compute_jacobian` after the poses. ``weight`` is that of
    angles. False if a pose is not finite.
    """
    count = len(start)
    matrices = np.empty((len(base) + 1, 4, 4))
    values, trial, trial_error = np.empty(len(base)), np.empty(count), np.empty(6)
    jacobian, gradient, step = np.empty((6, count)), np.empty(count), np.empty(count)
    free, normal = np.empty(count, np.int64), np.empty((count, count + 1))
    best[:] = start
    damping, cost = 1e-2, 0.0
    for iteration in range(max_iterations + 1):
        # The first pass evaluates the start, the others the result of a step.
        if iteration == 0:
            trial[:] = start
        else:
            if (
                _length(error, 0) <= tolerance_mm and _length(error, 3) <= tolerance_rad * weight
            ) or damping > 1e8:
                return True
            jacobian[:] = 0.0
            _fill_positions(best, base, drivers, driver_gains, values)
            compute_link_poses(values, *tree, matrices)
            compute_jacobian(matrices, *link, jacobian)
            used = 0
            for k in range(count):
                gradient[k] = 0.0
                for i in range(6):
                    if i >= 3:
                        jacobian[i, k] *= weight
                    gradient[k] += jacobian[i, k] * error[i]
                # A joint at a limit, with a step beyond it, is held in this step.
                held = (best[k] <= lower[k] and gradient[k] < 0.0) or (
                    best[k] >= upper[k] and gradient[k] > 0.0
                )
                step[k] = 0.0
                if not held:
                    free[used] = k
                    used += 1
            if used == 0:
                return True
            total = 0.0
            for i in range(used):
                for j in range(used):
                    product = 0.0
                    for k in range(6):
                        product += jacobian[k, free[i]] * jacobian[k, free[j]]
                    normal[i, j] = product
                normal[i, used] = gradient[free[i]]
                total += normal[i, i]
            for i in range(used):
                normal[i, i] += damping * (normal[i, i] + 1e-9 * max(total, 1e-12))
            _solve(normal, used)
            longest = 1e-300
            for i in range(used):
                step[free[i]] = normal[i, used]
                longest = max(longest, abs(normal[i, used]))
            # At most half a turn: the linear model is not valid beyond it.
            scale = min(1.0, math.pi / longest)
            for k in range(count):
                trial[k] = min(max(best[k] + scale * step[k], lower[k]), upper[k])
        _fill_positions(trial, base, drivers, driver_gains, values)
        if not compute_link_poses(values, *tree, matrices):
            return False
        _error_of(goal, matrices[link[0]], weight, trial_error)
        reached = 0.0
        for i in range(6):
            reached += trial_error[i] * trial_error[i]
        if iteration == 0:
            cost = reached
            error[:] = trial_error
        elif reached < cost:
            stalled = reached > (1.0 - min_cost_drop) * cost
            cost, damping = reached, max(damping * 0.1, 1e-15)
            best[:] = trial
            error[:] = trial_error
            if stalled:
                return True
        else:
            damping *= 10.0
    return True


@njit(cache=True, error_model="numpy")
def _fill_positions(
    given: FloatArray,
    base: FloatArray,
    drivers: NDArray[np.int64],
    driver_gains: FloatArray,
    values: FloatArray,
) -> None:
    for k in range(len(base)):
        values[k] = base[k]
        if drivers[k] >= 0:
            values[k] += driver_gains[k] * given[drivers[k]]


@njit(cache=True, error_model="numpy")
def _length(error: FloatArray, first: int) -> float:
    return math.sqrt(error[first] ** 2 + error[first + 1] ** 2 + error[first + 2] ** 2)


@njit(cache=True, error_model="numpy")
def _error_of(goal: FloatArray, reached: FloatArray, weight: float, error: FloatArray) -> None:
    """Write the way to ``goal``: mm, and the rotation vector of `vector_of_rotation` weighted."""
    turn = np.empty((3, 3))
    for i in range(3):
        error[i] = goal[i, 3] - reached[i, 3]
        for j in range(3):
            turn[i, j] = 0.0
            for k in range(3):
                turn[i, j] += goal[i, k] * reached[j, k]
    a, e, i = turn[0, 0], turn[1, 1], turn[2, 2]
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    trace = a + e + i
    largest = max(a, e, i, trace)
    if a == largest:
        x, y, z, w = 1.0 - trace + 2.0 * a, turn[1, 0] + turn[0, 1], turn[2, 0] + turn[0, 2], x
    elif e == largest:
        x, y, z, w = turn[0, 1] + turn[1, 0], 1.0 - trace + 2.0 * e, turn[2, 1] + turn[1, 2], y
    elif i == largest:
        x, y, z, w = turn[0, 2] + turn[2, 0], turn[1, 2] + turn[2, 1], 1.0 - trace + 2.0 * i, z
    else:
        w = 1.0 + trace
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if w < 0.0:
        norm = -norm
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    angle = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)
    if angle <= 1e-3:
        scale = 2.0 + angle**2 / 12.0 + 7.0 * angle**4 / 2880.0
    else:
        scale = angle / math.sin(0.5 * angle)
    error[3], error[4], error[5] = weight * scale * x, weight * scale * y, weight * scale * z


@njit(cache=True, error_model="numpy")
def _solve(system: FloatArray, count: int) -> None:
    """Solve ``count`` equations in place, whose right side is column ``count``.

    The matrix is symmetric and positive definite: it needs no pivots.
    """
    for k in range(count):
        for i in range(k + 1, count):
            factor = system[i, k] / system[k, k]
            for j in range(k, count + 1):
                system[i, j] -= factor * system[k, j]
    for k in range(count - 1, -1, -1):
        for j in range(k + 1, count):
            system[k, count] -= system[k, j] * system[j, count]
        system[k, count] /= system[k, k]
