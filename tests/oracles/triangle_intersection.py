"""Intersection of two triangles by linear programming (SciPy).

It is independent of `app.fixture`: it compares no distances, but searches for a common point of the
two triangles.
"""

import numpy as np
from scipy.optimize import linprog

from app.geometry import FloatArray


def triangles_intersect(first: FloatArray, second: FloatArray) -> bool:
    """True if two triangles (3, 3) share a point that is no combination of shared corners."""
    common = {tuple(p) for p in first} & {tuple(p) for p in second}
    own = np.array([float(tuple(p) not in common) for p in [*first, *second]])
    equal = np.zeros((5, 6))
    equal[:3] = np.concatenate([first, -second]).T
    equal[3, :3] = equal[4, 3:] = 1.0
    found = linprog(-own, A_eq=equal, b_eq=[0.0, 0.0, 0.0, 1.0, 1.0])
    if not common or len(common) == 3:
        return bool(found.success)
    return bool(-found.fun > 1e-6)
