"""Where to put a camera so that all that matters is seen. Points and directions in RAS, mm."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray

_AZIMUTHS = 24
_ELEVATIONS_DEG = (10.0, 25.0, 40.0)
_HIDING_COSTS = 3.0
_ROOM = 1.06
"""Space around the content, as a factor of the distance."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A perspective camera: all (3,), ``up`` a unit vector."""

    position: FloatArray
    focal_point: FloatArray
    up: FloatArray


def best_direction(
    subject: FloatArray, others: FloatArray, up: FloatArray, along: FloatArray | None = None
) -> FloatArray:
    """The unit direction, from the scene to the camera, that shows ``subject`` (n, 3) best.

    Best is where few points of ``others`` (m, 3) stand in front of the subject and, among those
    views, where ``along`` (3,) is least foreshortened; without it, where the whole spreads widest
    over the picture, since things that are spread out do not hide each other.
    """
    center = subject.mean(axis=0)
    offset = others - center
    radius = float(np.linalg.norm(subject - center, axis=1).max())
    everything = np.concatenate([subject, others])
    size = float(np.linalg.norm(np.ptp(everything, axis=0))) ** 2

    def score(towards: FloatArray) -> float:
        right, over = _axes(towards, up)
        hidden = _hidden(offset, radius, right, over, towards)
        shown = (
            float(np.hypot(along @ right, along @ over) / np.linalg.norm(along))
            if along is not None
            else float(np.ptp(everything @ right) * np.ptp(everything @ over)) / size
        )
        return shown - _HIDING_COSTS * hidden

    return max(_directions(up), key=score)


def fit(
    points: FloatArray, towards: FloatArray, up: FloatArray, *, angle_deg: float, aspect: float
) -> Camera:
    """The nearest camera in direction ``towards`` that has all ``points`` (n, 3) in its picture.

    ``angle_deg`` is the vertical angle of view, ``aspect`` width over height of the picture.
    """
    right, over = _axes(towards, up)
    tan_y = np.tan(np.radians(0.5 * angle_deg)) / _ROOM
    tan_x = tan_y * aspect
    x, y, z = points @ right, points @ over, points @ towards
    # A point is in the picture when |x - cx| <= (distance - z) tan: its two sides give the
    # extremes of x + z tan and x - z tan, of which the middle is the centre.
    center_x, reach_x = _side(x, z, tan_x)
    center_y, reach_y = _side(y, z, tan_y)
    distance = max(reach_x, reach_y)
    focal_z = float(np.median(z))
    focal_point = center_x * right + center_y * over + focal_z * towards
    return Camera(focal_point + (distance - focal_z) * towards, focal_point, over)


def _side(across: FloatArray, towards: FloatArray, tan: float) -> tuple[float, float]:
    low = float((across - towards * tan).min())
    high = float((across + towards * tan).max())
    return 0.5 * (low + high), 0.5 * (high - low) / tan


def _directions(up: FloatArray) -> Iterator[FloatArray]:
    forward = _any_perpendicular(up)
    side = np.cross(up, forward)
    for elevation in np.radians(_ELEVATIONS_DEG):
        for azimuth in np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False):
            level = np.cos(azimuth) * forward + np.sin(azimuth) * side
            yield np.cos(elevation) * level + np.sin(elevation) * up


def _hidden(
    offset: FloatArray, radius: float, right: FloatArray, over: FloatArray, towards: FloatArray
) -> float:
    """The part of the points ``offset`` (m, 3) from a ball's centre that stand in front of it."""
    if not len(offset):
        return 0.0
    near = np.hypot(offset @ right, offset @ over) < radius
    return float((near & (offset @ towards > 0.0)).mean())


def _axes(towards: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Right and up of the picture."""
    right = np.cross(up, towards)
    length = float(np.linalg.norm(right))
    right = _any_perpendicular(towards) if length < 1e-9 else right / length
    return right, np.cross(towards, right)


def _any_perpendicular(vector: FloatArray) -> FloatArray:
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(vector)))] = 1.0
    perpendicular = np.cross(vector, axis)
    return perpendicular / np.linalg.norm(perpendicular)
