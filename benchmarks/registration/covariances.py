"""Comparison of predicted covariances with actual errors."""

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from app.geometry import FloatArray
from app.registration import calibrate_pivot, calibrate_spin, register_points, solve_robot_world
from app.registration.motion import motion_between
from benchmarks.registration.figures import EM_NOISE, FRAMES, Figure
from tests.registration.helpers import (
    draw,
    pivot_scene,
    random_covariances,
    random_layout,
    random_transform,
    robot_world_scene,
)


def calibration_of_covariances(trials: int) -> Iterator[Figure]:
    """Yield the mean normalised squared error of each method."""
    # Separate generators: no figure depends on the others.
    streams = [np.random.default_rng([4, index]) for index in range(4)]

    def points(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        truth, moving = random_transform(rng), random_layout(rng, 6)
        noise = random_covariances(rng, 6)
        fixed = truth.apply(moving) + draw(rng, noise)
        result = register_points(fixed, moving, covariances_mm2=noise, **FRAMES)
        return motion_between(truth, result.transform), np.asarray(result.covariance)

    def base(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = robot_world_scene(rng, 15, EM_NOISE)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        motion = [
            motion_between(scene.base, result.reference_from_base),
            motion_between(scene.mount, result.tip_from_sensor),
        ]
        return np.concatenate(motion), result.covariance

    def pivot(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = pivot_scene(rng, 80, cone_deg=60.0, noise=EM_NOISE)
        result = calibrate_pivot(scene.poses, noise=EM_NOISE)
        return result.tip_mm - scene.tip_mm, result.covariance[:3, :3]

    def spin(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        scene = pivot_scene(rng, 200, cone_deg=0.0, noise=EM_NOISE, spin_deg=40.0)
        result = calibrate_spin(scene.poses, tip_mm=scene.tip_mm)
        across = np.linalg.svd(result.shaft[None])[2][1:]
        error = across @ (scene.tip_mm / np.linalg.norm(scene.tip_mm) - result.shaft)
        return error, across @ result.covariance @ across.T

    for trial, rng in zip((points, base, pivot, spin), streams, strict=True):
        squared, size = [], 0
        for _ in range(trials):
            error, covariance = trial(rng)
            squared.append(float(error @ np.linalg.solve(covariance, error)))
            size = len(error)
        # A short run tests four bands at once and must rarely fail by chance.
        tail = 0.025 if trials >= 500 else 0.0005
        low, high = chi2.ppf([tail, 1.0 - tail], size * trials) / (size * trials)
        mean = float(np.mean(squared)) / size
        yield Figure(
            "covariance",
            f"normalised squared error, {trial.__name__}, {trials} trials",
            f"{mean:.3f}",
            f"{low:.3f} to {high:.3f}",
            "not available in other implementations",
            low <= mean <= high,
        )
