"""Random, non-degenerate geometries for the tests of registration."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.registration.pose_stack import PoseNoise


def random_transform(
    rng: np.random.Generator, target: str = "fixed", source: str = "moving", reach_mm: float = 300.0
) -> Transform:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Transform(target, source, rotation, rng.uniform(-reach_mm, reach_mm, 3))


def motion_between(truth: Transform, estimate: Transform) -> FloatArray:
    """Return the motion (6,) about the origin that maps ``estimate`` to ``truth``.

    The rotation vector is exact for large rotations. The translation is that of the origin, as in
    `app.registration.small_motion`.
    """
    rotation = truth.rotation @ estimate.rotation.T
    shift = truth.translation_mm - rotation @ estimate.translation_mm
    turn = Rotation.from_matrix(rotation).as_rotvec()
    return np.concatenate([turn, shift])


def random_layout(
    rng: np.random.Generator, count: int, *, spread_mm: float = 60.0, min_ratio: float = 0.2
) -> FloatArray:
    """Points (count, 3) in mm, rotated and off centre, that are not close to a line."""
    while True:
        axes = Rotation.random(random_state=rng).as_matrix() * rng.uniform(0.3, 1.0, 3)
        points = rng.normal(size=(count, 3)) * spread_mm @ axes.T
        values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if values[1] > min_ratio * values[0]:
            return points + rng.uniform(-400.0, 400.0, 3)


def random_covariances(
    rng: np.random.Generator, count: int, *, low_mm: float = 0.1, high_mm: float = 1.0
) -> FloatArray:
    """Rotated, anisotropic covariances (count, 3, 3) in mm2."""
    axes = Rotation.random(count, random_state=rng).as_matrix()
    sigmas = rng.uniform(low_mm, high_mm, (count, 1, 3))
    return (axes * sigmas**2) @ np.swapaxes(axes, 1, 2)


def draw(rng: np.random.Generator, covariances: FloatArray) -> FloatArray:
    """Draw one error vector (n, 3) per covariance (n, 3, 3)."""
    return np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(len(covariances), 3))
    )


def disturbed(rng: np.random.Generator, pose: Transform, noise: PoseNoise) -> Transform:
    """Return ``pose`` with measurement noise added."""
    turn = Rotation.from_rotvec(rng.normal(scale=noise.rotation_rad, size=3)).as_matrix()
    shift = rng.normal(scale=noise.translation_mm, size=3)
    return Transform(pose.target, pose.source, turn @ pose.rotation, pose.translation_mm + shift)


@dataclass(frozen=True)
class RobotWorldScene:
    """Poses of a robot in a workspace half a metre from its base, and of a sensor on its tip."""

    base: Transform
    mount: Transform
    robot: list[Transform]
    sensor: list[Transform]
    centre_mm: FloatArray
    """Centre (3,) of the workspace in the reference frame."""


def robot_world_scene(
    rng: np.random.Generator, count: int, noise: PoseNoise | None, *, tilt_rad: float = 0.7
) -> RobotWorldScene:
    base = random_transform(rng, "reference", "base")
    mount = random_transform(rng, "tip", "sensor", reach_mm=60.0)
    middle = np.array([350.0, 0.0, 200.0])
    facing = Rotation.random(random_state=rng)
    robot = [
        Transform(
            "base",
            "tip",
            (Rotation.from_rotvec(rng.uniform(-tilt_rad, tilt_rad, 3)) * facing).as_matrix(),
            middle + rng.uniform(-100.0, 100.0, 3),
        )
        for _ in range(count)
    ]
    true = [base @ pose @ mount for pose in robot]
    sensor = true if noise is None else [disturbed(rng, pose, noise) for pose in true]
    return RobotWorldScene(base, mount, robot, sensor, base.apply(middle))


@dataclass(frozen=True)
class PivotScene:
    """Poses ``reference_from_tool`` of a tool that rotates about its tip.

    ``wrong`` are the indices of poses with a gross error.
    """

    tip_mm: FloatArray
    pivot_mm: FloatArray
    poses: list[Transform]
    wrong: tuple[int, ...]


def pivot_scene(
    rng: np.random.Generator,
    count: int,
    *,
    cone_deg: float,
    noise: PoseNoise | None,
    wrong_share: float = 0.0,
    spin_deg: float = 15.0,
) -> PivotScene:
    """The shaft fills a cone of opening ``cone_deg``; the tool spins by up to ``spin_deg``."""
    shaft = Rotation.random(random_state=rng).apply([0.0, 0.0, 1.0])
    tip = shaft * rng.uniform(80.0, 200.0)
    pivot = rng.uniform(-200.0, 200.0, 3)
    facing = Rotation.random(random_state=rng)
    wrong = np.sort(rng.choice(count, int(wrong_share * count), replace=False)).tolist()
    poses = []
    for index in range(count):
        across = np.cross(shaft, rng.normal(size=3))
        across /= np.linalg.norm(across)
        tilt = np.radians(cone_deg / 2.0) * np.sqrt(rng.uniform())
        spin = np.radians(rng.uniform(-spin_deg, spin_deg))
        turn = facing * Rotation.from_rotvec(tilt * across) * Rotation.from_rotvec(spin * shaft)
        pose = Transform("reference", "tool", turn.as_matrix(), pivot - turn.apply(tip))
        if noise is not None:
            pose = disturbed(rng, pose, noise)
        if index in wrong:
            pose = disturbed(rng, pose, PoseNoise(0.2, 15.0))
        poses.append(pose)
    return PivotScene(tip, pivot, poses, tuple(wrong))
