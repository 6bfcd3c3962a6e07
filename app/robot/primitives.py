"""Boxes, cylinders, spheres, cones and capsules as closed triangle surfaces at the origin."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.robot.elements import RobotMeshError

Surface = tuple[FloatArray, NDArray[np.int64]]

SIDES = 48
"""Corners of a circle. They are on the circle: the surface is inside the ideal one by at most
0.21 % of the radius."""


def box(size: Sequence[float]) -> Surface:
    """Return a centred box with edge lengths ``size`` (3,), in their unit."""
    half = _sizes("box", size, 3) / 2.0
    signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return signs * half, np.array(faces)


def cylinder(radius: float, length: float) -> Surface:
    """Return a centred cylinder along z, as in URDF."""
    radius, length = _sizes("cylinder", (radius, length), 2)
    heights = np.array([-0.5, -0.5, 0.5, 0.5]) * length
    return revolved(np.array([0.0, radius, radius, 0.0]), heights)


def sphere(radius: float) -> Surface:
    """Return a centred sphere with poles on z."""
    (radius,) = _sizes("sphere", (radius,), 1)
    latitude = np.linspace(-math.pi / 2.0, math.pi / 2.0, SIDES // 2 + 1)
    radii = radius * np.cos(latitude)
    radii[[0, -1]] = 0.0
    return revolved(radii, radius * np.sin(latitude))


def cone(radius: float, height: float) -> Surface:
    """Return a cone along z with its tip up and its middle at the origin, as in AMBF (Bullet)."""
    radius, height = _sizes("cone", (radius, height), 2)
    return revolved(np.array([0.0, radius, 0.0]), np.array([-0.5, -0.5, 0.5]) * height)


def capsule(radius: float, height: float) -> Surface:
    """Return a centred capsule along z; ``height`` is between the centres of its ends (Bullet)."""
    radius, height = _sizes("capsule", (radius, height), 2)
    latitude = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    radii, heights = radius * np.cos(latitude), radius * np.sin(latitude) + 0.5 * height
    radii[-1] = 0.0
    return revolved(np.concatenate([radii[::-1], radii]), np.concatenate([-heights[::-1], heights]))


def revolved(radii: FloatArray, heights: FloatArray, sides: int = SIDES) -> Surface:
    """Return the surface of a profile rotated about z.

    ``radii`` (n,) begin and end with 0; ``heights`` (n,) increase. A circle has ``sides`` corners.
    """
    angle = np.linspace(0.0, math.tau, sides, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    rings = [
        ring * radius + (0.0, 0.0, height)
        for radius, height in zip(radii[1:-1], heights[1:-1], strict=True)
    ]
    poles = np.array([[0.0, 0.0, heights[0]], [0.0, 0.0, heights[-1]]])
    corner = np.arange(sides)
    following = (corner + 1) % sides
    bottom, top = len(rings) * sides, len(rings) * sides + 1
    last = (len(rings) - 1) * sides
    faces = [np.stack([np.full(sides, bottom), following, corner], axis=1)]
    for low in range(0, last, sides):
        up = low + sides
        faces.append(np.stack([low + corner, low + following, up + following], axis=1))
        faces.append(np.stack([low + corner, up + following, up + corner], axis=1))
    faces.append(np.stack([last + corner, last + following, np.full(sides, top)], axis=1))
    return np.concatenate([*rings, poles]), np.concatenate(faces)


def _sizes(kind: str, values: Sequence[float], count: int) -> FloatArray:
    sizes = np.array(values, dtype=np.float64)
    if sizes.shape != (count,) or not (np.isfinite(sizes).all() and (sizes > 0.0).all()):
        raise RobotMeshError(
            f"sizes of a {kind} are {sizes.tolist()}; expected {count} numbers above 0"
        )
    return sizes
