"""Pivot and spin calibration by the methods of other programs.

Independent of `app.registration.tool`, which maximises a likelihood over robustly selected poses:
plain least squares, and an eigenvector of the rotations between successive poses.
"""

from itertools import pairwise

import numpy as np

from app.geometry import FloatArray, Transform


def least_squares_pivot(poses: list[Transform]) -> FloatArray:
    """Tip (3,) in mm by least squares, with one rejection of poses beyond 3 sigma, as in IGSIO."""
    kept = np.ones(len(poses), dtype=bool)
    for _ in range(2):
        rows = np.concatenate([np.hstack([p.rotation, -np.eye(3)]) for p in poses])
        right = -np.concatenate([p.translation_mm for p in poses])
        used = np.repeat(kept, 3)
        solution = np.linalg.lstsq(rows[used], right[used], rcond=None)[0]
        distances = np.linalg.norm((rows @ solution - right).reshape(-1, 3), axis=1)
        kept = distances < distances.mean() + 3.0 * distances.std()
    return solution[:3]


def eigenvector_spin(poses: list[Transform]) -> FloatArray:
    """Axis (3,) as the smallest eigenvector of the sum of ``(R - 1)^T (R - 1)``, as in IGSIO.

    R are the rotations between successive poses.
    """
    scatter = np.zeros((3, 3))
    for first, second in pairwise(poses):
        change = first.rotation.T @ second.rotation - np.eye(3)
        scatter += change.T @ change
    return np.linalg.eigh(scatter)[1][:, 0]
