"""Nearest twist within half-spaces by non-negative least squares, independent of the limiters.

Least distance programming after Lawson and Hanson (Solving Least Squares Problems, chapter 23).
"""

import numpy as np
from scipy.optimize import lsq_linear, nnls

from app.geometry import FloatArray

_FEASIBLE = 1e-13
_TOLERANCE = 1e-9


def nearest_point(point: FloatArray, rows: FloatArray, lower: FloatArray) -> FloatArray | None:
    """The x (n,) nearest to ``point`` with ``rows @ x >= lower``; None if there is none."""
    # With x = point + z: minimise |z| subject to rows @ z >= lower - rows @ point.
    needed = lower - rows @ point
    size = max(float(np.abs(needed).max()), 1e-12)
    matrix = np.vstack([rows.T, needed / size])
    matrix /= np.linalg.norm(matrix, axis=0)
    target = np.zeros(len(point) + 1)
    target[-1] = 1.0
    for solve in (_lawson_hanson, _bounded_variables):
        residual = matrix @ solve(matrix, target) - target
        if -residual[-1] < _FEASIBLE:
            return None
        found = point - size * residual[:-1] / residual[-1]
        # With opposite planes at the same place the first solver sometimes ends too early.
        if (rows @ found >= lower - _TOLERANCE * max(size, 1.0)).all():
            return np.asarray(found)
    raise ArithmeticError("neither solver of the oracle found the nearest point")


def _lawson_hanson(matrix: FloatArray, target: FloatArray) -> FloatArray:
    return np.asarray(nnls(matrix, target)[0])


def _bounded_variables(matrix: FloatArray, target: FloatArray) -> FloatArray:
    found = lsq_linear(matrix, target, (0.0, np.inf), method="bvls", tol=1e-15)
    return np.asarray(found.x)
