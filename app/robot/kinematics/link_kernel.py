"""Compiled forward kinematics and Jacobian, because they run at every step of a session.

A module of its own, so that the compiler is loaded only when a link pose is computed.
"""

import math

import numpy as np
from numba import njit
from numba.core.runtime.nrt import rtsys
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations


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
