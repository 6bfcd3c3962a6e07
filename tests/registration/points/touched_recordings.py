"""Landmarks touched by a stylus that turns about its tip, with errors correlated over time."""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import f

from app.geometry import NS_PER_S, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import detect_dwells, register_points, tre_covariances
from tests.registration.tool.correlated_poses import RATE_HZ, SECONDS, errors

LANDMARKS = 8
SIGMA_MM, SIGMA_RAD = 0.15, np.radians(0.07)
TIP_MM = np.array([0.0, 0.0, 150.0])
REST_S = 1.6


def touched(kind: str, seed: int) -> tuple[list[TrackedTransform], np.ndarray]:
    """Poses of the tip in `reference`, and the true landmarks (n, 3), not in one plane."""
    rng = np.random.default_rng([seed, len(kind)])
    corners = np.array([(x, y, z) for x in (-50, 50) for y in (-40, 40) for z in (-30, 30)])
    landmarks = rng.permutation(corners + rng.uniform(-15.0, 15.0, corners.shape))[:LANDMARKS]
    times = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    each_s = SECONDS / LANDMARKS
    number = (times / each_s).astype(int)
    moved = np.clip((times % each_s - REST_S) / (each_s - REST_S), 0.0, 1.0)[:, None]
    after = landmarks[np.minimum(number + 1, LANDMARKS - 1)]
    tips = (1.0 - moved) * landmarks[number] + moved * after
    angles = 0.5 * np.sin(2.0 * np.pi * times / REST_S)
    true = Rotation.random(random_state=rng) * Rotation.from_rotvec(
        angles[:, None] * np.array([np.cos(0.3), np.sin(0.3), 0.0])
    )
    sensors = tips - true.apply(TIP_MM) + SIGMA_MM * errors(rng, kind)
    measured = Rotation.from_rotvec(SIGMA_RAD * errors(rng, kind)) * true
    places = sensors + measured.apply(TIP_MM)
    return [
        TrackedTransform(
            Transform("reference", "tip", rotation, place),
            Stamp(round(time * NS_PER_S)),
            TrackingStatus.OK,
        )
        for time, rotation, place in zip(times, measured.as_matrix(), places, strict=True)
    ], landmarks


def squared_errors(kind: str, seed: int, counts: tuple[int, ...]) -> list[float]:
    """Squared errors at a target over the quantile: at most 1 inside the 95 % region.

    The first dwells, of each of ``counts``, are registered to the true landmarks.
    """
    samples, landmarks = touched(kind, seed)
    dwells = np.array([dwell.position_mm for dwell in detect_dwells(samples)])
    nearest = np.linalg.norm(dwells[:, None] - landmarks[None], axis=2).argmin(axis=1)
    target = np.random.default_rng(seed).uniform(-60.0, 60.0, 3)
    squares = []
    for count in counts:
        found = register_points(
            dwells[:count],
            landmarks[nearest[:count]],
            fixed_frame="reference",
            moving_frame="phantom",
        )
        error = found.transform.apply(target) - target
        covariance = tre_covariances(found, target[None])[0]
        assert found.degrees_of_freedom is not None
        quantile = 3.0 * f.ppf(0.95, 3, found.degrees_of_freedom)
        squares.append(float(error @ np.linalg.solve(covariance, error)) / quantile)
    return squares
