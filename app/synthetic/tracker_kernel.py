"""Compiled errors of a simulated tracker, because a simulation measures thousands of poses.

A module of its own, so that the compiler is loaded only when a pose is measured. The rotations are
those of `app.geometry.rotations`.
"""

import math

import numpy as np
from numba import njit
from numba.core.runtime.nrt import rtsys

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations

SOFT_MM = 1.0
"""The direction away from the metal is smooth within this distance of it."""


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def measure_poses(
    true_rotations: FloatArray,
    true_positions_mm: FloatArray,
    metal_mm: FloatArray,
    distortion: FloatArray,
    errors: FloatArray,
    quanta: FloatArray,
    rotations: FloatArray,
    positions_mm: FloatArray,
) -> None:
    """Write ``rotations`` (n, 3, 3) and ``positions_mm`` (n, 3) that a tracker reports of n poses.

    The true ones are in the tracker. ``metal_mm`` (n, 2, 3) are the ends of the metal,
    ``distortion`` (3,) shift in mm, turn in rad and reach in mm; without a shift and a turn the
    metal is not used. Each of the ``errors`` (n, k, 6) displaces the pose by the first three
    numbers, in mm in the tracker, and turns it about the sensor by the others, in rad. ``quanta``
    (2,) are those of the position in mm and of a component of the quaternion; 0 leaves it as it is.
    """
    for n in range(len(true_rotations)):
        rotation, position_mm = rotations[n], positions_mm[n]
        for i in range(3):
            position_mm[i] = true_positions_mm[n, i]
            for j in range(3):
                rotation[i, j] = true_rotations[n, i, j]
        if distortion[0] != 0.0 or distortion[1] != 0.0:
            _distort(metal_mm[n], distortion, rotation, position_mm)
        for k in range(errors.shape[1]):
            _turn(rotation, errors[n, k, 3], errors[n, k, 4], errors[n, k, 5])
            for i in range(3):
                position_mm[i] += errors[n, k, i]
        if quanta[0] > 0.0:
            for i in range(3):
                position_mm[i] = np.round(position_mm[i] / quanta[0]) * quanta[0]
        if quanta[1] > 0.0:
            _round_quaternion(quanta[1], rotation)


@njit(cache=True, error_model="numpy")
def _distort(
    metal_mm: FloatArray, distortion: FloatArray, rotation: FloatArray, position_mm: FloatArray
) -> None:
    """Displace and turn a pose by the field near a straight piece of metal."""
    along, away = metal_mm[1] - metal_mm[0], position_mm - metal_mm[0]
    square = max(along[0] * along[0] + along[1] * along[1] + along[2] * along[2], 1e-12)
    share = (away[0] * along[0] + away[1] * along[1] + away[2] * along[2]) / square
    share = min(max(share, 0.0), 1.0)
    for i in range(3):
        away[i] -= share * along[i]
    distance = math.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
    soft, length = math.hypot(distance, SOFT_MM), max(math.sqrt(square), 1e-12)
    for i in range(3):
        away[i] /= soft
        along[i] /= length
    share = 1.0 / (1.0 + (distance / distortion[2]) ** 4)
    axis, turn = np.empty(3), np.empty(3)
    for i in range(3):
        after, before = (i + 1) % 3, (i + 2) % 3
        axis[i] = along[after] * away[before] - along[before] * away[after]
    for i in range(3):
        turn[i] = rotation[0, i] * axis[0] + rotation[1, i] * axis[1] + rotation[2, i] * axis[2]
        turn[i] *= distortion[1] * share
    _turn(rotation, turn[0], turn[1], turn[2])
    for i in range(3):
        position_mm[i] += distortion[0] * share * away[i]


@njit(cache=True, error_model="numpy")
def _turn(rotation: FloatArray, x: float, y: float, z: float) -> None:
    """Multiply ``rotation`` by that of the vector (x, y, z) in rad, from the right."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle <= 1e-3:
        square = angle * angle
        scale = 0.5 - square / 48.0 + square * square / 3840.0
    else:
        scale = math.sin(0.5 * angle) / angle
    turn = np.empty((3, 3))
    _write_matrix(scale * x, scale * y, scale * z, math.cos(0.5 * angle), turn)
    for i in range(3):
        a, b, c = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        for j in range(3):
            rotation[i, j] = a * turn[0, j] + b * turn[1, j] + c * turn[2, j]


@njit(cache=True, error_model="numpy")
def _round_quaternion(quantum: float, rotation: FloatArray) -> None:
    """Round the components of the quaternion with w >= 0 to multiples of ``quantum``."""
    a, e, i = rotation[0, 0], rotation[1, 1], rotation[2, 2]
    x = rotation[2, 1] - rotation[1, 2]
    y = rotation[0, 2] - rotation[2, 0]
    z = rotation[1, 0] - rotation[0, 1]
    xy = rotation[1, 0] + rotation[0, 1]
    xz = rotation[2, 0] + rotation[0, 2]
    yz = rotation[2, 1] + rotation[1, 2]
    trace = a + e + i
    largest = max(a, e, i, trace)
    if a == largest:
        x, y, z, w = 1.0 - trace + 2.0 * a, xy, xz, x
    elif e == largest:
        x, y, z, w = xy, 1.0 - trace + 2.0 * e, yz, y
    elif i == largest:
        x, y, z, w = xz, yz, 1.0 - trace + 2.0 * i, z
    else:
        w = 1.0 + trace
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if w < 0.0:
        norm = -norm
    x, y = np.round(x / norm / quantum) * quantum, np.round(y / norm / quantum) * quantum
    z, w = np.round(z / norm / quantum) * quantum, np.round(w / norm / quantum) * quantum
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    _write_matrix(x / norm, y / norm, z / norm, w / norm, rotation)


@njit(cache=True, error_model="numpy")
def _write_matrix(x: float, y: float, z: float, w: float, matrix: FloatArray) -> None:
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww
