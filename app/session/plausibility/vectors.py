"""Vectors of three plain floats, which are faster than arrays of this size."""

import math

from app.geometry import FloatArray

Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)


def distance_to_path(at: Vector, velocity: Vector, start_s: float, end_s: float) -> float:
    """Distance from ``at`` to the segment from ``velocity * start_s`` to ``velocity * end_s``."""
    x, y, z = at
    u, v, w = velocity
    square = u * u + v * v + w * w
    if square == 0.0:
        return math.sqrt(x * x + y * y + z * z)
    time_s = (x * u + y * v + z * w) / square
    if time_s < start_s:  # comparisons: `min` and `max` take longer than the rest
        time_s = start_s
    if time_s > end_s:
        time_s = end_s
    x, y, z = x - time_s * u, y - time_s * v, z - time_s * w
    return math.sqrt(x * x + y * y + z * z)


def rotation_vector(rotation: FloatArray) -> Vector:
    """Axis times angle in rad of a rotation (3, 3).

    The axis is unreliable within 1e-6 rad of half a turn, the angle is not.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    x, y, z = h - f, c - g, d - b  # the axis times twice the sine
    twice_sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(twice_sine, a + e + i - 1.0)
    if twice_sine < 1e-9:
        return (angle, 0.0, 0.0)
    scale = angle / twice_sine
    return (x * scale, y * scale, z * scale)
