"""Compiled heights of a tool above a tumour, because a simulation needs them at 1000 poses.

A module of its own, so that the compiler is loaded only when a case is simulated.
"""

import math

from numba import njit
from numba.core.runtime.nrt import rtsys

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations

ROUNDING_MM = 1e-9


@load_without_declarations(rtsys)
@njit(cache=True, error_model="numpy")
def heights_of_tool(
    points_mm: FloatArray,
    rotation: FloatArray,
    translation_mm: FloatArray,
    semi_axes_mm: FloatArray,
    lobe_centres: FloatArray,
    lobe_heights: FloatArray,
    lobe_sharpness: FloatArray,
    max_radius_mm: float,
    block: int,
    block_centres_mm: FloatArray,
    block_radii_mm: FloatArray,
    distance_per_height: float,
    for_distance: bool,
    begin: int,
    heights_mm: FloatArray,
) -> int:
    """Write ``heights_mm`` (n,) of the moved ``points_mm`` (n, 3); return the index of the lowest.

    Heights are those of `Tumour.height_mm`. A point that is neither the lowest one nor, with
    ``for_distance``, the nearest one outside may have an infinite height. The lowest height and the
    least distance are at most the height of any point. Bounds of both are:

    - The distance to the tumour's centre minus ``max_radius_mm``.
    - Outside, a height changes by at most the way over ``distance_per_height``; a distance is at
      least the height times ``distance_per_height``. The way is that from the last computed point.

    Each ``block`` of successive points is in a sphere, ``block_centres_mm`` (k, 3) and
    ``block_radii_mm`` (k,). The point ``begin`` is computed first: heights do not depend on it, but
    a low one leaves out more points.
    """
    share = distance_per_height if for_distance else 1.0
    count = len(points_mm)
    heights_mm[:] = math.inf
    lowest, at = math.inf, begin
    # The last computed point and its height.
    u, v, w = points_mm[begin, 0], points_mm[begin, 1], points_mm[begin, 2]
    height = -math.inf
    for k in range(-1, len(block_radii_mm)):
        first, last = begin, begin + 1
        if k >= 0:
            first, last = k * block, min((k + 1) * block, count)
            p, q, s = block_centres_mm[k, 0], block_centres_mm[k, 1], block_centres_mm[k, 2]
            way = math.sqrt((p - u) ** 2 + (q - v) ** 2 + (s - w) ** 2) + block_radii_mm[k]
            if share * (height - way / distance_per_height) > max(lowest, 0.0):
                continue
            x = rotation[0, 0] * p + rotation[0, 1] * q + rotation[0, 2] * s + translation_mm[0]
            y = rotation[1, 0] * p + rotation[1, 1] * q + rotation[1, 2] * s + translation_mm[1]
            z = rotation[2, 0] * p + rotation[2, 1] * q + rotation[2, 2] * s + translation_mm[2]
            beyond = math.sqrt(x * x + y * y + z * z) - block_radii_mm[k] - max_radius_mm
            if beyond > max(lowest, 0.0):
                continue
        for n in range(first, last):
            p, q, s = points_mm[n, 0], points_mm[n, 1], points_mm[n, 2]
            way = math.sqrt((p - u) ** 2 + (q - v) ** 2 + (s - w) ** 2)
            if share * (height - (way + ROUNDING_MM) / distance_per_height) > max(lowest, 0.0):
                continue
            x = rotation[0, 0] * p + rotation[0, 1] * q + rotation[0, 2] * s + translation_mm[0]
            y = rotation[1, 0] * p + rotation[1, 1] * q + rotation[1, 2] * s + translation_mm[1]
            z = rotation[2, 0] * p + rotation[2, 1] * q + rotation[2, 2] * s + translation_mm[2]
            distance = math.sqrt(x * x + y * y + z * z)
            if distance - max_radius_mm > max(lowest, 0.0):
                continue
            if distance > 0.0:
                x, y, z = x / distance, y / distance, z / distance
            else:
                x, y, z = 0.0, 0.0, 1.0
            a, b, c = x / semi_axes_mm[0], y / semi_axes_mm[1], z / semi_axes_mm[2]
            lobes = 0.0
            for i in range(len(lobe_heights)):
                cosine = x * lobe_centres[i, 0] + y * lobe_centres[i, 1]
                cosine += z * lobe_centres[i, 2]
                lobes += lobe_heights[i] * math.exp(lobe_sharpness[i] * (cosine - 1.0))
            height = distance - (1.0 + lobes) / math.sqrt(a * a + b * b + c * c)
            u, v, w = p, q, s
            heights_mm[n] = height
            if height < lowest:
                lowest, at = height, n
    return at
