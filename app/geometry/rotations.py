"""Conversions between rotation matrices, quaternions (xyzw) and rotation vectors.

The functions of arrays do the same operations in the same order as those of one rotation, so that
the bits agree. `scipy.spatial.transform.Rotation` converts a single rotation with the same
formulas, to the same digits, in 20 to 50 us, most of it for the choice of an array library; the
functions of one rotation take 3 us.
"""

import math

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


# `scipy.spatial.transform.Rotation` does the same with the same formulas, to the same digits, in
# 20 to 50 us for a single rotation, most of it for the choice of an array library. These take 3
# us.

_SMALL_RAD = 1e-3
"""Below it, series of Taylor are more exact than the formulas with sines."""


def rotation_of_vector(vector: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of ``vector`` (3,): an axis times an angle in rad."""
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle <= _SMALL_RAD:
        square = angle * angle
        scale = 0.5 - square / 48.0 + square * square / 3840.0
    else:
        scale = math.sin(0.5 * angle) / angle
    return _matrix(scale * x, scale * y, scale * z, math.cos(0.5 * angle))


def vector_of_rotation(rotation: FloatArray) -> FloatArray:
    """Return the axis times the angle in [0, pi] rad, (3,), of a rotation (3, 3)."""
    x, y, z, w = canonical_quaternion(rotation).tolist()
    angle = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)
    if angle <= _SMALL_RAD:
        square = angle * angle
        scale = 2.0 + square / 12.0 + 7.0 * square * square / 2880.0
    else:
        scale = angle / math.sin(0.5 * angle)
    return np.array([scale * x, scale * y, scale * z])


def canonical_quaternion(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion xyzw, (4,), with w >= 0, of a rotation (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    trace = a + e + i
    largest = max(a, e, i, trace)
    if a == largest:
        x, y, z, w = 1.0 - trace + 2.0 * a, d + b, g + c, h - f
    elif e == largest:
        x, y, z, w = b + d, 1.0 - trace + 2.0 * e, h + f, c - g
    elif i == largest:
        x, y, z, w = c + g, f + h, 1.0 - trace + 2.0 * i, d - b
    else:
        x, y, z, w = h - f, c - g, d - b, 1.0 + trace
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if w < 0.0:
        norm = -norm
    return np.array([x / norm, y / norm, z / norm, w / norm])


def _matrix(x: float, y: float, z: float, w: float) -> FloatArray:
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    return np.array(
        [
            [xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)],
            [2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)],
            [2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww],
        ]
    )
