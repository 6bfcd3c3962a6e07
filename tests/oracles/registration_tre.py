"""Target registration error by the published formula for isotropic noise.

Independent of `app.registration.registration_checks`, which propagates a covariance: evaluates the
formula of Fitzpatrick, West and Maurer (1998) on the principal axes of the landmarks.
"""

import numpy as np

from app.geometry import FloatArray


def fitzpatrick_tre(landmarks: FloatArray, targets: FloatArray, fle_mm: float) -> FloatArray:
    """RMS target error (m,) in mm for landmarks (n, 3), targets (m, 3) and a 3-D RMS FLE."""
    centred = landmarks - landmarks.mean(axis=0)
    axes = np.linalg.svd(centred)[2]

    def squared_distances(points: FloatArray) -> FloatArray:
        along = (points - landmarks.mean(axis=0)) @ axes.T
        return np.sum(along**2, axis=1, keepdims=True) - along**2

    ratio = squared_distances(targets) / squared_distances(landmarks).mean(axis=0)
    return np.sqrt(fle_mm**2 / len(landmarks) * (1.0 + ratio.sum(axis=1) / 3.0))
