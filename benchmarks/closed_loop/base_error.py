"""Errors of the registration of an arm's base, drawn inside the covariance that it predicts."""

import numpy as np

from app.geometry import FloatArray, Transform
from app.registration import register_points

SIGMA_MM = 1.0
"""Standard deviation of a touched landmark along each axis."""

LANDMARKS_MM = np.array(
    [[140, -60, 40], [140, 60, 40], [260, -60, 40], [260, 60, 40], [200, 0, 110], [170, 0, 20]],
    dtype=np.float64,
)
"""Around the tumour of the shipped world, in the base's frame."""

CHI2_95 = 12.59
"""95 % quantile of the chi-squared distribution with 6 degrees of freedom."""

_MAX_DRAWS = 1000


def drawn_registration(seed: int) -> Transform:
    """``tracker_from_base`` of a base at the tracker's origin, from noisy landmarks.

    The registration's error is inside the 95 % ellipsoid of its predicted covariance; a draw
    outside it is drawn again.
    """
    random = np.random.default_rng([seed, 7])
    for _ in range(_MAX_DRAWS):
        measured = LANDMARKS_MM + random.normal(scale=SIGMA_MM, size=LANDMARKS_MM.shape)
        found = register_points(
            measured,
            LANDMARKS_MM,
            fixed_frame="tracker",
            moving_frame="base",
            covariances_mm2=SIGMA_MM**2 * np.eye(3),
        )
        assert found.covariance is not None
        motion = _small_motion(found.transform)
        if float(motion @ np.linalg.solve(found.covariance, motion)) <= CHI2_95:
            return found.transform
    raise AssertionError("95 of 100 draws are expected inside the ellipsoid")


def _small_motion(tracker_from_base: Transform) -> FloatArray:
    """The motion (6,), rad and mm, that turns the registration into the true one, the identity."""
    error = tracker_from_base.inverse()
    return np.concatenate([error.rotation_vector, error.translation_mm])
