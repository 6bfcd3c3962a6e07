"""Compiled target registration error, because it is computed at every step of a session.

A module of its own, so that the compiler is loaded only when an error is computed.
"""

import math
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.runtime.nrt import rtsys

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations


def variance_mm2(
    quadratic: FloatArray, linear: FloatArray, constant: float, x: Any, y: Any, z: Any
) -> Any:
    """Return ``p A p - 2 b p + c`` at points p in mm, each coordinate a number or an array.

    ``quadratic`` A is symmetric (3, 3), ``linear`` b is (3,). Rounding may make it negative.
    """
    squares = quadratic[0, 0] * x * x + quadratic[1, 1] * y * y + quadratic[2, 2] * z * z
    mixed = quadratic[0, 1] * x * y + quadratic[0, 2] * x * z + quadratic[1, 2] * y * z
    return squares + 2.0 * (mixed - (linear[0] * x + linear[1] * y + linear[2] * z)) + constant


_variance_mm2: Callable[..., float] = njit(error_model="numpy")(variance_mm2)


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def largest_variance_mm2(
    quadratic: FloatArray,
    linear: FloatArray,
    constant: float,
    rotation: FloatArray,
    tip_mm: FloatArray,
    other_rotation: FloatArray,
    other_tip_mm: FloatArray,
    points_mm: FloatArray,
) -> float:
    """Return the largest `variance_mm2` at the tip and at ``points_mm`` (m, 3), or NaN if one is.

    ``rotation`` (3, 3) and ``tip_mm`` (3,) are the pose of the tip in the fixed frame, the others
    that in the frame of the points.
    """
    largest = _variance_mm2(quadratic, linear, constant, tip_mm[0], tip_mm[1], tip_mm[2])
    for k in range(len(points_mm)):
        x, y, z = tip_mm[0], tip_mm[1], tip_mm[2]
        for j in range(3):
            at_tip = 0.0  # coordinate j of the point in the frame of the tip
            for i in range(3):
                at_tip += other_rotation[i, j] * (points_mm[k, i] - other_tip_mm[i])
            x += rotation[0, j] * at_tip
            y += rotation[1, j] * at_tip
            z += rotation[2, j] * at_tip
        variance = _variance_mm2(quadratic, linear, constant, x, y, z)
        if variance > largest or math.isnan(variance):
            largest = variance
    return largest
