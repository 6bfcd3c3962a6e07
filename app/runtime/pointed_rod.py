"""A closed rod with a point: a needle or a stylus that is drawn without a model of its own."""

import numpy as np

from app.geometry import SurfaceMesh

_SIDES = 16


def pointed_rod(length_mm: float, radius_mm: float, point_mm: float, frame: str) -> SurfaceMesh:
    """A rod along z in ``frame``, its tip at 0 and its other end at ``-length_mm``.

    The last ``point_mm``, or half of a shorter rod, are a cone.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = -length_mm, -min(point_mm, 0.5 * length_mm)
    rings = [np.column_stack([circle, np.full(_SIDES, height)]) for height in heights]
    poles = np.array([[0.0, 0.0, -length_mm], [0.0, 0.0, 0.0]])
    low = np.arange(_SIDES)
    following = (low + 1) % _SIDES
    back, tip = np.full(_SIDES, 2 * _SIDES), np.full(_SIDES, 2 * _SIDES + 1)
    faces = [
        (back, following, low),
        (low, following, following + _SIDES),
        (low, following + _SIDES, low + _SIDES),
        (low + _SIDES, following + _SIDES, tip),
    ]
    corners = np.concatenate([np.stack(each, axis=1) for each in faces])
    return SurfaceMesh(frame, np.concatenate([*rings, poles]), corners.astype(np.int32))
