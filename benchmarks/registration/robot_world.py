"""Registration of a robot's base from noisy pose pairs, compared with OpenCV's closed forms."""

from collections.abc import Iterator

import numpy as np

from app.geometry import Transform
from app.registration import solve_robot_world
from benchmarks.registration.figures import EM_NOISE, Figure, rms
from tests.registration.helpers import robot_world_scene


def robot_world(trials: int) -> Iterator[Figure]:
    """Yield the error of the base at the centre of the workspace."""
    import cv2

    rng = np.random.default_rng(2)
    errors: dict[str, list[float]] = {}
    for _ in range(trials):
        scene = robot_world_scene(rng, 15, EM_NOISE)
        middle = scene.base.inverse().apply(scene.centre_mm)
        world, gripper = (
            [p.inverse() for p in scene.sensor],
            [p.inverse() for p in scene.robot],
        )
        answers = {
            "known noise": solve_robot_world(
                scene.robot, scene.sensor, noise=EM_NOISE
            ).reference_from_base,
            "noise estimated": solve_robot_world(scene.robot, scene.sensor).reference_from_base,
        }
        for name, method in (("Shah", 0), ("Li", 1)):
            rotation, translation, _, _ = cv2.calibrateRobotWorldHandEye(
                [p.rotation for p in world],
                [p.translation_mm for p in world],
                [p.rotation for p in gripper],
                [p.translation_mm for p in gripper],
                method=method,
            )
            answers[name] = Transform("reference", "base", rotation, translation.ravel())
        for name, answer in answers.items():
            error = np.linalg.norm(answer.apply(middle) - scene.centre_mm)
            errors.setdefault(name, []).append(float(error))
    texts = {
        name: f"{rms(values):.3f} RMS, {np.quantile(values, 0.95):.3f} p95"
        for name, values in errors.items()
    }
    peers = f"OpenCV Shah {texts['Shah']}; Li {texts['Li']}"
    for name in ("known noise", "noise estimated"):
        good = rms(errors[name]) <= 0.30 and np.quantile(errors[name], 0.95) <= 0.45
        yield Figure(
            "robot-world",
            f"base at the workspace centre, 15 poses, {trials} trials, {name}",
            texts[name] + " mm",
            "0.30 RMS, 0.45 p95 mm",
            peers,
            bool(good),
        )
