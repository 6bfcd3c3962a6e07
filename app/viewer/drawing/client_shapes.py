"""Surfaces that the page draws besides the models: of size 1, placed by a matrix."""

from enum import StrEnum

import numpy as np

from app.geometry import FloatArray
from app.viewer.drawing.arrays import Values, encoded

_SIDES, _RINGS = 12, 7


class Shape(StrEnum):
    """The name of a surface on the page."""

    BALL = "ball"
    """Radius 1 around the origin."""
    ROD = "rod"
    """Radius 1 around z, from 0 to 1."""
    PLANE = "square"
    """Sides of 1 in x and y around the origin."""


def shape_surface(shape: Shape) -> Values:
    """The points, faces and normals of ``shape``, encoded for the page."""
    if shape is Shape.PLANE:
        corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
        return _surface(corners, [[0, 1, 2], [0, 2, 3]], np.tile([0.0, 0.0, 1.0], (4, 1)))
    if shape is Shape.ROD:
        ring = _ring()
        points = np.concatenate([ring, ring + _along_z(1.0)])
        return _surface(points, _bands(2), np.concatenate([ring, ring]))
    polar = np.linspace(0.0, np.pi, _RINGS)
    rings = [_ring() * np.sin(a) + _along_z(np.cos(a)) for a in polar]
    points = np.concatenate(rings)
    return _surface(points, _bands(_RINGS), points)


def _along_z(height: float) -> FloatArray:
    return np.array([0.0, 0.0, height])


def _ring() -> FloatArray:
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)])


def _bands(rings: int) -> list[list[int]]:
    """The triangles between rings of points, one ring after the other."""
    faces = []
    for ring in range(rings - 1):
        for side in range(_SIDES):
            a, b = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
            faces += [[a, b, b + _SIDES], [a, b + _SIDES, a + _SIDES]]
    return faces


def _surface(points: FloatArray, faces: list[list[int]], normals: FloatArray) -> Values:
    return {
        "points": encoded(points.astype(np.float32)),
        "polys": encoded(np.array([[3, *face] for face in faces], np.uint32)),
        "normals": encoded(normals.astype(np.float32)),
        "colors": None,
    }
