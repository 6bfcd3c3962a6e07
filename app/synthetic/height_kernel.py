"""Compiled heights of a tool above a tumour, because a simulation needs them at 1000 poses.

A module of its own, so that the compiler is loaded only when a case is simulated.
"""

import math

from numba import njit
from numba.core.runtime.nrt import rtsys

from app.geometry import FloatArray
from app.geometry.jit_cache import load_without_declarations


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
    block_reaches_mm: FloatArray,
    distance_per_height: float,
    for_distance: bool,
    heights_mm: FloatArray,
) -> float:
    """Write ``heights_mm`` (n,) of the moved ``points_mm`` (n, 3), and return the lowest.

    Heights are those of `Tumour.height_mm`. A point that is neither the lowest one nor, with
    ``for_distance``, the nearest one outside may have an infinite height. The lowest height and the
    least distance are at most the height of any point. Bounds of both are:

    - The distance to the tumour's centre minus ``max_radius_mm``.
    - Outside, a height changes by at most the way over ``distance_per_height``; a distance is at
      least the height times ``distance_per_height``.

    Each ``block`` of successive points is in a sphere, ``block_centres_mm`` (k, 3) and
    ``block_radii_mm`` (k,), and within ``block_reaches_mm`` (k,) of its first point. The first
    points are tried first, then the blocks that this leaves.
    """
    share = distance_per_height if for_distance else 1.0
    count = len(points_mm)
    lowest = math.inf
    heights_mm[:] = math.inf
    for everything in range(2):
        for k in range(len(block_radii_mm)):
            first = k * block
            last = first + 1
            if everything:
                p, q, s = block_centres_mm[k, 0], block_centres_mm[k, 1], block_centres_mm[k, 2]
                x = rotation[0, 0] * p + rotation[0, 1] * q + rotation[0, 2] * s + translation_mm[0]
                y = rotation[1, 0] * p + rotation[1, 1] * q + rotation[1, 2] * s + translation_mm[1]
                z = rotation[2, 0] * p + rotation[2, 1] * q + rotation[2, 2] * s + translation_mm[2]
                beyond = math.sqrt(x * x + y * y + z * z) - block_radii_mm[k] - max_radius_mm
                slope_mm = block_reaches_mm[k] / distance_per_height
                known = heights_mm[first] < math.inf
                if known and share * (heights_mm[first] - slope_mm) > max(lowest, 0.0):
                    continue
                if beyond > max(lowest, 0.0):
                    continue
                last = min(first + block, count)
            for n in range(first, last):
                p, q, s = points_mm[n, 0], points_mm[n, 1], points_mm[n, 2]
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
                heights_mm[n] = distance - (1.0 + lobes) / math.sqrt(a * a + b * b + c * c)
                lowest = min(lowest, heights_mm[n])
    return lowest
