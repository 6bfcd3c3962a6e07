"""Pivot and spin of a tool that swings for 20 s, with errors that are correlated over time."""

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from app.geometry import Transform
from app.registration import calibrate_pivot, calibrate_spin, select_pivot_poses, select_poses

RATE_HZ, SECONDS = 40.0, 20.0
SIGMA_MM, SIGMA_RAD = 0.3, np.radians(0.15)
KINDS = {
    "white": 0.0,
    "40 ms": 0.04,
    "80 ms": 0.08,
    "400 ms": 0.4,
    "pink": None,
    "anisotropic": 0.0,
}
"""Name -> correlation time in s."""


def errors(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Errors (n, 3) of standard deviation 1, and of 0.4, 0.8 and 1.5 if anisotropic."""
    white = rng.standard_normal((int(RATE_HZ * SECONDS), 3))
    tau = KINDS[kind]
    if tau is None:
        power = np.append(0.0, 1.0 / np.arange(1, len(white) // 2 + 1))
        shaped = np.sqrt(power)[:, None] * np.fft.rfft(white, axis=0)
        return np.fft.irfft(shaped, len(white), axis=0) * np.sqrt(0.5 * len(white) / power.sum())
    if tau > 0.0:
        kept = np.exp(-1.0 / (RATE_HZ * tau))
        white[1:] *= np.sqrt(1.0 - kept**2)
        return lfilter([1.0], [1.0, -kept], white, axis=0)
    return white * ((0.4, 0.8, 1.5) if kind == "anisotropic" else 1.0)


def swing(rng: np.random.Generator, kind: str, *, spin: bool) -> tuple[np.ndarray, list[Transform]]:
    """The tip (3,) in the tool's frame, and the measured poses."""
    times = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    shaft = Rotation.random(random_state=rng).apply([0.0, 0.0, 1.0])
    tip, pivot = shaft * rng.uniform(80.0, 200.0), rng.uniform(-200.0, 200.0, 3)
    x = np.cross(shaft, rng.normal(size=3))
    x /= np.linalg.norm(x)
    tilt = np.radians(30.0) * (0.5 + 0.5 * np.sin(2.0 * np.pi * 0.07 * times + phases[0]))
    azimuth = 2.0 * np.pi * rng.uniform(0.25, 0.5) * times + phases[1]
    across = np.cos(azimuth)[:, None] * x + np.sin(azimuth)[:, None] * np.cross(shaft, x)
    turned = np.radians(60.0 if spin else 15.0) * np.sin(2.0 * np.pi * 0.2 * times + phases[2])
    true = Rotation.random(random_state=rng) * Rotation.from_rotvec(turned[:, None] * shaft)
    if not spin:
        true = true * Rotation.from_rotvec(tilt[:, None] * across)
    places = pivot - true.apply(tip) + SIGMA_MM * errors(rng, kind)
    measured = Rotation.from_rotvec(SIGMA_RAD * errors(rng, kind)) * true
    return tip, [
        Transform("reference", "tool", rotation, place)
        for rotation, place in zip(measured.as_matrix(), places, strict=True)
    ]


def squared_error(kind: str, seed: int, *, spin: bool, selected: bool) -> float:
    """Squared error in standard deviations over the 95 % quantile: at most 1 inside the region."""
    rng = np.random.default_rng([seed, len(kind), spin])
    tip, poses = swing(rng, kind, spin=spin)
    if spin:
        chosen = select_poses(poses, min_distance_mm=0.0) if selected else range(len(poses))
        found = calibrate_spin([poses[index] for index in chosen], tip_mm=tip)
        basis = np.linalg.svd(found.shaft[None])[2][1:]
        error = basis @ (tip / np.linalg.norm(tip) - found.shaft)
        covariance = basis @ found.covariance @ basis.T
    else:
        chosen = select_pivot_poses(poses) if selected else range(len(poses))
        result = calibrate_pivot([poses[index] for index in chosen])
        error, covariance = result.tip_mm - tip, result.covariance[:3, :3]
    return float(error @ np.linalg.solve(covariance, error)) / chi2.ppf(0.95, len(error))
