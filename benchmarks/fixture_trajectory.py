"""A tool that wanders around a tumour: smooth, seeded, near the surface, any side towards it."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, SurfaceMesh, Transform

_KNOT = 25
"""The slide is computed at every 25th pose and interpolated between."""


def wander(
    tumor: SurfaceMesh,
    tool: SurfaceMesh,
    steps: int,
    *,
    rate_hz: float = 1000.0,
    seed: int = 0,
    gap_mm: tuple[float, float] = (0.0, 10.0),
) -> list[Transform]:
    """Poses of the tool, ``steps`` at ``rate_hz``, with its surface some ``gap_mm`` away.

    Direction of approach, orientation, gap, and the place along the tool's longest axis that leads
    follow sums of slow sines, so that the tip leads in some poses and the flank in others. Poses
    are slid along the direction until the nearest vertices are the gap apart.
    """
    time = np.arange(steps) / rate_hz
    rng = np.random.default_rng(seed)
    towards = _slow(rng, time, 3) + np.array([0.0, 0.0, 0.3])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    turns = Rotation.from_rotvec(1.5 * _slow(rng, time, 3))
    low, high = gap_mm
    gaps = low + (high - low) * (0.5 + 0.5 * np.sin(2.0 * np.pi * (0.5 * time + 0.25)))
    near, far = tool.bounds_mm
    along = int(np.argmax(far - near))
    leading = np.tile(0.5 * (near + far), (steps, 1))
    leading[:, along] = far[along] - (far - near)[along] * np.clip(
        0.25 + 0.2 * _slow(rng, time, 1)[:, 0], 0.0, 1.0
    )
    tree = cKDTree(tumor.vertices_mm)
    middle = 0.5 * sum(tumor.bounds_mm)
    reach = 0.5 * float(np.linalg.norm(tumor.bounds_mm[1] - tumor.bounds_mm[0]))
    rotations = turns.as_matrix()
    knots = np.unique(np.append(np.arange(0, steps, _KNOT), steps - 1))
    away = np.empty(len(knots))
    for place, k in enumerate(knots):
        vertices = middle + (tool.vertices_mm - leading[k]) @ rotations[k].T
        away[place] = reach + high if place == 0 else away[place - 1] + 2.0
        for _ in range(6):
            moved = vertices + away[place] * towards[k]
            away[place] -= _nearest_mm(tree, moved, middle, reach) - gaps[k]
    away = np.interp(np.arange(steps), knots, away)
    translations = middle + away[:, None] * towards - np.einsum("kij,kj->ki", rotations, leading)
    return [
        Transform(tumor.frame, tool.frame, rotation, translation)
        for rotation, translation in zip(rotations, translations, strict=True)
    ]


def _nearest_mm(tree: cKDTree, points: FloatArray, middle: FloatArray, reach: float) -> float:
    """The smallest distance to ``tree``, all of whose points are within ``reach`` of ``middle``."""
    at_least = np.linalg.norm(points - middle, axis=1) - reach
    first = np.argpartition(at_least, min(8, len(points) - 1))[:8]
    nearest = tree.query(points[first])[0].min()
    return float(
        tree.query(points[at_least <= nearest], distance_upper_bound=nearest + 1e-9)[0].min()
    )


def _slow(rng: np.random.Generator, time: FloatArray, count: int) -> FloatArray:
    """(n, count): sums of three sines below 0.4 Hz each."""
    frequency = rng.uniform(0.05, 0.4, size=(3, count))
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(3, count))
    return np.sin(2.0 * np.pi * frequency * time[:, None, None] + phase).sum(axis=1)
