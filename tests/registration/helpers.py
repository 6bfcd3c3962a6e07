"""Random geometries that are not degenerate, shared by the tests of this room."""

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform


def random_transform(
    rng: np.random.Generator, target: str = "fixed", source: str = "moving", reach_mm: float = 300.0
) -> Transform:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Transform(target, source, rotation, rng.uniform(-reach_mm, reach_mm, 3))


def random_layout(
    rng: np.random.Generator, count: int, *, spread_mm: float = 60.0, least_ratio: float = 0.2
) -> FloatArray:
    """Points (count, 3), rotated and off centre, whose second spread is no sliver."""
    while True:
        axes = Rotation.random(random_state=rng).as_matrix() * rng.uniform(0.3, 1.0, 3)
        points = rng.normal(size=(count, 3)) * spread_mm @ axes.T
        values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if values[1] > least_ratio * values[0]:
            return points + rng.uniform(-400.0, 400.0, 3)


def random_covariances(
    rng: np.random.Generator, count: int, *, low_mm: float = 0.1, high_mm: float = 1.0
) -> FloatArray:
    """A rotated, anisotropic covariance (count, 3, 3) in mm2 for each point."""
    axes = Rotation.random(count, random_state=rng).as_matrix()
    sigmas = rng.uniform(low_mm, high_mm, (count, 1, 3))
    return (axes * sigmas**2) @ np.swapaxes(axes, 1, 2)


def draw(rng: np.random.Generator, covariances: FloatArray) -> FloatArray:
    """One error vector (n, 3) from each covariance (n, 3, 3)."""
    return np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(len(covariances), 3))
    )
