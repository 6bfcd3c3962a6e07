"""A monopolar cautery as one closed surface: spatula blade, thin shaft, handle."""

from functools import cache
from itertools import pairwise

import numpy as np

from app.geometry import FloatArray, SurfaceMesh

CAUTERY_TIP_FRAME = "cautery_tip"

SEGMENTS = 24
"""Points per ring around the tool's axis."""

PROFILE_MM = (
    # (from the tip back along the axis, half width in x, half thickness in y)
    (0.15, 0.45, 0.20),
    (0.50, 0.80, 0.34),
    (1.10, 1.10, 0.40),
    (2.00, 1.25, 0.40),
    (14.0, 1.25, 0.45),
    (18.0, 1.40, 1.40),
    (62.0, 1.40, 1.40),
    (66.0, 3.50, 3.50),
    (72.0, 5.00, 5.00),
    (110.0, 6.00, 6.00),
    (128.0, 5.00, 5.00),
    (130.0, 3.00, 3.00),
)
"""The tool's outline. The rings of the blade are flat ellipses, all others circles."""

RING_SPACING_MM = 2.6
"""Maximum distance between rings on the part that comes near the tumour."""

NEAR_PART_MM = 66.0


@cache
def cautery_mesh() -> SurfaceMesh:
    """The tool in ``cautery_tip``: tip at the origin, +z forward, the handle along -z."""
    behind_mm, half_x_mm, half_y_mm = _rings()
    angles = np.arange(SEGMENTS) * (2.0 * np.pi / SEGMENTS)
    rings = np.empty((len(behind_mm), SEGMENTS, 3))
    rings[..., 0] = half_x_mm[:, None] * np.cos(angles)
    rings[..., 1] = half_y_mm[:, None] * np.sin(angles)
    rings[..., 2] = -behind_mm[:, None]
    back = (0.0, 0.0, -float(behind_mm[-1]))
    vertices = np.concatenate([[(0.0, 0.0, 0.0)], rings.reshape(-1, 3), [back]])

    def index(ring: int, segment: int) -> int:
        return 1 + ring * SEGMENTS + segment % SEGMENTS

    last, end = len(behind_mm) - 1, len(vertices) - 1
    faces = [(0, index(0, s), index(0, s + 1)) for s in range(SEGMENTS)]
    for ring in range(last):
        for s in range(SEGMENTS):
            faces.append((index(ring, s), index(ring + 1, s), index(ring, s + 1)))
            faces.append((index(ring, s + 1), index(ring + 1, s), index(ring + 1, s + 1)))
    faces += [(end, index(last, s + 1), index(last, s)) for s in range(SEGMENTS)]
    return SurfaceMesh(CAUTERY_TIP_FRAME, vertices, np.array(faces))


def _rings() -> tuple[FloatArray, FloatArray, FloatArray]:
    behind_mm, half_x_mm, half_y_mm = np.array(PROFILE_MM).T
    knots = [behind_mm[:1]]
    for start, stop in pairwise(behind_mm.tolist()):
        spacing = RING_SPACING_MM if stop <= NEAR_PART_MM else 4.0 * RING_SPACING_MM
        count = max(1, int(np.ceil((stop - start) / spacing)))
        knots.append(np.linspace(start, stop, count + 1)[1:])
    rings = np.concatenate(knots)
    return rings, np.interp(rings, behind_mm, half_x_mm), np.interp(rings, behind_mm, half_y_mm)
