"""Camera placement that shows given points. Points and directions in RAS, mm."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray

_AZIMUTHS = 24
_ELEVATIONS_DEG = (10.0, 25.0, 40.0)
_OCCLUSION_WEIGHT = 3.0
_SPACE_FACTOR = 1.06
"""Free space around the content, as a factor of the distance."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A perspective camera. All are (3,); ``up`` is a unit vector."""

    position: FloatArray
    focal_point: FloatArray
    up: FloatArray


def best_direction(
    subject: FloatArray, others: FloatArray, up: FloatArray, along: FloatArray | None = None
) -> FloatArray:
    """The unit direction, from the scene to the camera, that shows ``subject`` (n, 3) best.

    The score falls with the share of ``others`` (m, 3) in front of the subject. It rises the less
    ``along`` (3,) is foreshortened; without ``along``, with the area that all points cover in the
    picture, because parts that are spread out hide each other less.
    """
    center = subject.mean(axis=0)
    offset = others - center
    radius = float(np.linalg.norm(subject - center, axis=1).max())
    everything = np.concatenate([subject, others])
    size = float(np.linalg.norm(np.ptp(everything, axis=0))) ** 2

    def score(towards: FloatArray) -> float:
        right, over = _axes(towards, up)
        occluded = _occluded_share(offset, radius, right, over, towards)
        clarity = (
            float(np.hypot(along @ right, along @ over) / np.linalg.norm(along))
            if along is not None
            else float(np.ptp(everything @ right) * np.ptp(everything @ over)) / size
        )
        return clarity - _OCCLUSION_WEIGHT * occluded

    return max(_directions(up), key=score)


def fit(
    points: FloatArray, towards: FloatArray, up: FloatArray, *, angle_deg: float, aspect: float
) -> Camera:
    """The nearest camera in direction ``towards`` that shows all ``points`` (n, 3).

    ``angle_deg`` is the vertical angle of view, ``aspect`` width over height of the picture.
    """
    right, over = _axes(towards, up)
    tan_y = np.tan(np.radians(0.5 * angle_deg)) / _SPACE_FACTOR
    tan_x = tan_y * aspect
    x, y, z = points @ right, points @ over, points @ towards
    # A point is in the picture if |x - cx| <= (distance - z) tan. The maximum of x + z tan and the
    # minimum of x - z tan bound the picture; their middle is the centre.
    center_x, reach_x = _extent(x, z, tan_x)
    center_y, reach_y = _extent(y, z, tan_y)
    distance = max(reach_x, reach_y)
    focal_z = float(np.median(z))
    focal_point = center_x * right + center_y * over + focal_z * towards
    return Camera(focal_point + (distance - focal_z) * towards, focal_point, over)


def _extent(across: FloatArray, towards: FloatArray, tan: float) -> tuple[float, float]:
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


def _occluded_share(
    offset: FloatArray, radius: float, right: FloatArray, over: FloatArray, towards: FloatArray
) -> float:
    """Share of the points ``offset`` (m, 3) from a ball's centre that are in front of the ball."""
    if not len(offset):
        return 0.0
    near = np.hypot(offset @ right, offset @ over) < radius
    return float((near & (offset @ towards > 0.0)).mean())


def _axes(towards: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors to the right and up in the picture."""
    right = np.cross(up, towards)
    length = float(np.linalg.norm(right))
    right = _any_perpendicular(towards) if length < 1e-9 else right / length
    return right, np.cross(towards, right)


def _any_perpendicular(vector: FloatArray) -> FloatArray:
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(vector)))] = 1.0
    perpendicular = np.cross(vector, axis)
    return perpendicular / np.linalg.norm(perpendicular)
