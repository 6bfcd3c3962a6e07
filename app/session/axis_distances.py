"""Distance from a point to a closed surface in the six anatomical directions.

The axes are those of the surface's frame, as in `app.geometry.anatomy`. The rays are parallel to
the axes, so the boxes of the triangles across an axis select the few that a ray may meet.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from app.geometry import ANATOMICAL_AXES, FloatArray, InputError, SurfaceMesh

_ROUNDING = 1e-9
"""A ray this far outside a triangle, as a part of its size, still meets it: no gap at an edge."""


class AxisDistances:
    """Finds where rays along the axes meet ``surface``, whose faces are oriented outward."""

    def __init__(self, surface: SurfaceMesh) -> None:
        self.surface = surface
        corners = surface.vertices_mm[surface.faces]
        self._corners: FloatArray = corners
        self._low: FloatArray = corners.min(axis=1)
        self._high: FloatArray = corners.max(axis=1)

    def at(self, point_mm: FloatArray) -> Mapping[str, float | None]:
        """Distances in mm from ``point_mm`` (3,) by letter, in the surface's frame.

        Positive: the ray enters the surface at this distance. Negative: the point is inside, and
        the ray leaves the surface after this distance. None: the ray does not meet the surface.
        Raises `InputError` for a point that is not finite.
        """
        point = np.asarray(point_mm, dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise InputError(f"point: {point}; expected three finite numbers")
        hits = [self._hits(point, axis) for axis in range(3)]
        found: dict[str, float | None] = {}
        for letter, direction in ANATOMICAL_AXES.items():
            axis = int(np.argmax(np.abs(direction)))
            found[letter] = _first(*hits[axis], float(direction[axis]))
        return found

    def _hits(self, point: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
        """Offsets (k,) along ``axis`` to the triangles met, and their outward normals' components.

        The components have the sign of the normal; their size has no meaning.
        """
        i, j = (axis + 1) % 3, (axis + 2) % 3
        met: NDArray[np.bool_] = (
            (self._low[:, i] <= point[i])
            & (point[i] <= self._high[:, i])
            & (self._low[:, j] <= point[j])
            & (point[j] <= self._high[:, j])
        )
        corners = self._corners[met]
        across = corners[:, :, [i, j]] - point[[i, j]]
        a, b, c = across[:, 0], across[:, 1], across[:, 2]
        # Twice the signed areas that the point makes with the sides: their sum is the triangle's.
        areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
        whole = areas.sum(axis=1)
        sign = np.sign(whole)
        inside = (whole != 0.0) & (
            (areas * sign[:, None]).min(axis=1, initial=np.inf) >= -_ROUNDING * np.abs(whole)
        )
        weights = areas[inside] / whole[inside, None]
        offsets = (weights * corners[inside][:, :, axis]).sum(axis=1) - point[axis]
        return offsets, sign[inside]


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _first(offsets: FloatArray, normals: FloatArray, direction: float) -> float | None:
    """The nearest hit in ``direction``, negative where the ray leaves the surface there."""
    ahead = offsets * direction >= 0.0
    if not ahead.any():
        return None
    distances, outward = offsets[ahead] * direction, normals[ahead] * direction
    nearest = int(np.argmin(distances))
    distance = float(distances[nearest])
    return -distance if outward[nearest] > 0.0 else distance
