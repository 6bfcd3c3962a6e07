"""A surface without symmetry, and points touched on it."""

import numpy as np
import trimesh

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.registration.small_motion import apply_motion
from tests.registration.helpers import random_transform


def mesh_of(shape: trimesh.Trimesh) -> SurfaceMesh:
    return SurfaceMesh("ct", shape.vertices, shape.faces)


def asymmetric_surface() -> trimesh.Trimesh:
    """An asymmetric closed surface, about 100 mm long."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    x, y, z = ball.vertices.T
    radius = 1.0 + 0.25 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.15 * np.sin(4 * z + 2 * x)
    return trimesh.Trimesh(ball.vertices * radius[:, None] * [50, 35, 25], ball.faces)


ASYMMETRIC_SURFACE = asymmetric_surface()


def touch_surface(
    rng: np.random.Generator, shape: trimesh.Trimesh, count: int, noise_mm: float
) -> tuple[Transform, FloatArray, Transform]:
    """Return the true transform, noisy points (n, 3) in the probe's frame, and a rough start."""
    truth = random_transform(rng, "ct", "probe")
    points, _ = trimesh.sample.sample_surface(shape, count, seed=int(rng.integers(2**31)))
    measured = truth.inverse().apply(points) + rng.normal(scale=noise_mm, size=(count, 3))
    rough = np.concatenate([rng.normal(scale=0.05, size=3), rng.normal(scale=3.0, size=3)])
    return truth, measured, apply_motion(truth, rough, points.mean(axis=0))
