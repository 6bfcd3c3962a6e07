"""Directions of a tool that the poses of a calibration have covered, for a live display."""

import math
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray

SECTORS = 8
MIN_TILT_RAD = math.radians(10.0)
"""Tilt from the mean direction above which a pose of a pivot covers its sector."""
_MAX_POINTS = 240


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Directions of the tool as points in a plane.

    ``points_deg`` (n, 2)
        Of a pivot: tilt of the shaft from its mean direction, in degrees along two axes at rest.
        Of a spin: the rotation about the shaft, as points of a circle with radius 30.
    ``sectors``
        True for each of 8 sectors, counted from +x towards +y, in which there is a pose.
    ``spread_rad``
        Largest angle between two directions (pivot) or two rotations (spin).
    """

    points_deg: FloatArray
    sectors: tuple[bool, ...]
    spread_rad: float


def pivot_coverage(rotations: FloatArray, shaft: FloatArray) -> Coverage:
    """Coverage by tools rotated by ``rotations`` (n, 3, 3), with the unit vector ``shaft`` (3,)."""
    directions = _thinned(rotations) @ shaft
    mean = directions.mean(axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-9)
    x, y = _axes_across(mean)
    across = np.stack([directions @ x, directions @ y], axis=1)
    tilts = np.arccos(np.clip(directions @ mean, -1.0, 1.0))
    lengths = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    points = across / lengths[:, None] * np.degrees(tilts)[:, None]
    spread = math.acos(float(np.clip((directions @ directions.T).min(), -1.0, 1.0)))
    return Coverage(points, _sectors(points[tilts >= MIN_TILT_RAD]), spread)


def spin_coverage(rotations: FloatArray, shaft: FloatArray) -> Coverage:
    """Coverage of the rotations (n, 3, 3) about the unit vector ``shaft`` (3,) of the tool."""
    used = _thinned(rotations)
    x, y = _axes_across(shaft)
    moved = used[0].T @ used @ x
    angles = np.arctan2(moved @ y, moved @ x)
    points = 30.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turned = (np.einsum("aij,bij->ab", used, used).min() - 1.0) / 2.0
    return Coverage(points, _sectors(points), math.acos(float(np.clip(turned, -1.0, 1.0))))


def _thinned(rotations: FloatArray) -> FloatArray:
    chosen = np.linspace(0, len(rotations) - 1, min(len(rotations), _MAX_POINTS))
    return np.asarray(rotations[np.unique(chosen.round().astype(int))])


def _axes_across(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (3,) across ``direction``, which change little when it changes little."""
    away = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(away, direction)
    x /= np.linalg.norm(x)
    return x, np.asarray(np.cross(direction, x))


def _sectors(points: FloatArray) -> tuple[bool, ...]:
    angles = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * math.pi)
    covered = set((angles / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS)
    return tuple(number in covered for number in range(SECTORS))
