"""Rotations of many quaternions, and quaternions of many rotations, as arrays.

The same operations in the same order as those of one rotation, so that the bits agree.
"""

import numpy as np

from app.geometry.transform import FloatArray


def rotations_of_quaternions(quaternions: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) of unit quaternions (n, 4), xyzw, by the Euler-Rodrigues formula.

    The same operations as in `rotation_of_quaternion`, on arrays; norms are not checked.
    """
    x, y, z, w = quaternions.T
    found = np.empty((len(quaternions), 3, 3))
    found[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    found[:, 0, 1] = 2.0 * (x * y - z * w)
    found[:, 0, 2] = 2.0 * (x * z + y * w)
    found[:, 1, 0] = 2.0 * (x * y + z * w)
    found[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    found[:, 1, 2] = 2.0 * (y * z - x * w)
    found[:, 2, 0] = 2.0 * (x * z - y * w)
    found[:, 2, 1] = 2.0 * (y * z + x * w)
    found[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return found


def quaternions_of_rotations(rotations: FloatArray) -> FloatArray:
    """Return the quaternions (n, 4), xyzw with w >= 0, of rotations (n, 3, 3).

    The same operations as in `quaternion_of_rotation`, on arrays.
    """
    a, b, c, d, e, f, g, h, i = rotations.reshape(-1, 9).T
    trace = a + e + i
    cases = [
        trace >= np.maximum(np.maximum(a, e), i),
        a >= np.maximum(e, i),
        e >= i,
        np.ones(len(rotations), np.bool_),
    ]
    found = np.stack(
        [
            np.select(cases, [h - f, 1.0 - trace + 2.0 * a, b + d, c + g]),
            np.select(cases, [c - g, b + d, 1.0 - trace + 2.0 * e, f + h]),
            np.select(cases, [d - b, c + g, f + h, 1.0 - trace + 2.0 * i]),
            np.select(cases, [1.0 + trace, h - f, c - g, d - b]),
        ],
        axis=1,
    )
    x, y, z, w = found.T
    norms = np.sqrt(x * x + y * y + z * z + w * w)
    below = (x < 0.0) | ((x == 0.0) & ((y < 0.0) | ((y == 0.0) & (z < 0.0))))
    norms = np.where((w < 0.0) | ((w == 0.0) & below), -norms, norms)
    return np.asarray(found / norms[:, None])
