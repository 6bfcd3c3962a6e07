"""Errors with noise-free data."""

from collections.abc import Iterator

import numpy as np

from app.registration import calibrate_pivot, register_points, solve_robot_world
from benchmarks.registration.figures import EM_NOISE, FRAMES, Figure
from tests.registration.helpers import (
    pivot_scene,
    random_layout,
    random_transform,
    robot_world_scene,
)


def noise_free(trials: int) -> Iterator[Figure]:
    """Yield the largest error of each method over random geometries."""
    rng = np.random.default_rng(1)
    worst = {"points": [0.0, 0.0], "robot-world": [0.0, 0.0], "pivot": [0.0, 0.0]}

    def record(name: str, millimetres: float, radians: float) -> None:
        worst[name] = [max(worst[name][0], millimetres), max(worst[name][1], radians)]

    for _ in range(trials):
        truth, moving = random_transform(rng), random_layout(rng, int(rng.integers(3, 12)))
        found = register_points(truth.apply(moving), moving, **FRAMES).transform
        distances = np.abs(found.apply(moving) - truth.apply(moving)).max()
        record("points", float(distances), found.angle_to(truth))
        scene = robot_world_scene(rng, 10, None)
        result = solve_robot_world(scene.robot, scene.sensor, noise=EM_NOISE)
        for one, other in (
            (result.reference_from_base, scene.base),
            (result.tip_from_sensor, scene.mount),
        ):
            record("robot-world", one.distance_mm_to(other), one.angle_to(other))
        pivot = pivot_scene(rng, 30, cone_deg=rng.uniform(31, 120), noise=None)
        tip = calibrate_pivot(pivot.poses, noise=EM_NOISE).tip_mm
        record("pivot", float(np.abs(tip - pivot.tip_mm).max()), 0.0)
    for name, (millimetres, radians) in worst.items():
        yield Figure(
            "noise-free",
            f"{name}: worst of {trials} random geometries",
            f"{millimetres:.1e} mm, {radians:.1e} rad",
            "1e-9 mm, 1e-10 rad",
            "",
            millimetres <= 1e-9 and radians <= 1e-10,
        )
