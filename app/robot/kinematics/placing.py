"""Where all links are, in one call of compiled code: a robot is placed at every step of a session.

In a file of its own, so that the compiler is loaded with the first robot that is placed.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from app.geometry import FloatArray


@njit(cache=True, error_model="numpy")
def place_links(
    positions: FloatArray,
    slides: NDArray[np.bool_],
    origins: FloatArray,
    turned: FloatArray,
    parents: NDArray[np.int64],
    matrices: FloatArray,
) -> bool:
    """Write ``root_from_link`` to ``matrices`` (n + 1, 4, 4); whether all places are finite.

    Of n joints from root to leaves, each with its link behind that of ``parents`` (n,):
    ``positions`` (n,), 0 for what does not move, in rad or, where it ``slides`` (n,), in m;
    ``origins`` (n, 4, 4); ``turned`` (2, n, 4, 4), the factors of its motion (`Joint.twist`).
    """
    for i in range(4):
        for j in range(4):
            matrices[0, i, j] = 1.0 if i == j else 0.0
    finite = True
    for k in range(len(positions)):
        position = positions[k]
        once = position if slides[k] else math.sin(position)
        twice = 0.0 if slides[k] else 1.0 - math.cos(position)
        above, here = matrices[parents[k]], matrices[k + 1]
        for j in range(4):
            x = origins[k, 0, j] + once * turned[0, k, 0, j] + twice * turned[1, k, 0, j]
            y = origins[k, 1, j] + once * turned[0, k, 1, j] + twice * turned[1, k, 1, j]
            z = origins[k, 2, j] + once * turned[0, k, 2, j] + twice * turned[1, k, 2, j]
            for i in range(3):
                here[i, j] = above[i, 0] * x + above[i, 1] * y + above[i, 2] * z
            here[3, j] = 0.0
        for i in range(4):
            here[i, 3] += above[i, 3]
            finite &= math.isfinite(here[i, 3])
    return finite
