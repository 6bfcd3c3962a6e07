"""Simulated cases whose breaches are predicted, and known.

In each case a cautery passes a lobed tumour. Its measured pose has an error of registration, pivot
and contour that is constant over the case, and jitter: white, and slow. The analysis sees the
distances and normals that the engine computes from the measured poses, and the covariances of the
errors. The truth is independent of it: the true poses at four times the rate, and the radius
function of the tumour (`app.synthetic.Clearance`), neither mesh nor engine.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.analysis.breach_probability import breach_probability, smoothed_distances
from app.fixture.proximity.engine import ProximityEngine
from app.geometry import FloatArray, Transform
from app.geometry.rotations import rotation_of_vector
from app.synthetic.truth import Clearance
from app.synthetic.tumour_and_tool import TIP_FRAME, TUMOR_FRAME, Tumour, tool_mesh

CASES_PER_TUMOUR = 100
RATE_HZ, CASE_S, TRUE_PER_FRAME = 40.0, 4.0, 4
SLOW_S = 0.3
"""Correlation time of the slow jitter."""


@dataclass(frozen=True)
class Prediction:
    """The probability that the analysis gives, and whether the tool was in the tumour."""

    probability: float
    breach: bool


def predictions(
    count: int, seed: int, *, jitter_mm: float = 0.12, error_scale: float = 1.0
) -> Iterator[Prediction]:
    """Simulate ``count`` cases; a hundred of them have the same tumour.

    ``jitter_mm`` is the RMS of the white and of the slow jitter along each axis; ``error_scale``
    scales the constant errors, 0.2 to 0.9 mm along each axis.
    """
    tool = tool_mesh()
    for number in range(count):
        random = np.random.default_rng([seed, number])
        if number % CASES_PER_TUMOUR == 0:
            tumour = Tumour.generate(random)
            clearance = Clearance(tumour, tool)
            engine = ProximityEngine(tumour.mesh(), tool)
        yield _case(random, tumour, clearance, engine, jitter_mm, error_scale)


def _case(
    random: np.random.Generator,
    tumour: Tumour,
    clearance: Clearance,
    engine: ProximityEngine,
    jitter_mm: float,
    error_scale: float,
) -> Prediction:
    frames = int(RATE_HZ * CASE_S)
    poses = _motion(random, tumour, frames * TRUE_PER_FRAME)
    breach = any(clearance.height_mm(pose) < 0.0 for pose in poses)
    # Pivot: an error along the tool is twice that across it. All of them are constant.
    turn = poses[len(poses) // 2].rotation
    pivot = np.diag(random.uniform(0.1, 0.5) * np.array([1.0, 1.0, 2.0])) ** 2
    covariances = {
        "registration": np.diag(random.uniform(0.2, 0.9, 3)) ** 2,
        "pivot": turn @ pivot @ turn.T,
        "contour": random.uniform(0.2, 0.7) ** 2 * np.eye(3),
    }
    covariances = {name: error_scale**2 * matrix for name, matrix in covariances.items()}
    error = random.multivariate_normal(np.zeros(3), sum(covariances.values(), np.zeros((3, 3))))
    jitter = jitter_mm * _jitter(random, frames)
    measured = [
        engine.evaluate(_shifted(pose, error + jitter))
        for pose, jitter in zip(poses[::TRUE_PER_FRAME], jitter, strict=True)
    ]
    times = np.arange(frames) / RATE_HZ
    distances = np.array([each.signed_distance_mm for each in measured])
    normals = np.array([each.normal for each in measured])
    held = np.full(frames, 1.0 / RATE_HZ)
    found = breach_probability(smoothed_distances(times, distances), normals, held, covariances)
    return Prediction(found.outcome.probability, breach)


def _motion(random: np.random.Generator, tumour: Tumour, count: int) -> list[Transform]:
    """True poses: along the tumour from one direction to another, nearest in the middle."""
    first = random.normal(size=3)
    first /= np.linalg.norm(first)
    axis = np.cross(first, random.normal(size=3))
    axis *= random.uniform(0.2, 1.0) / np.linalg.norm(axis)
    tilt = rotation_of_vector(0.4 * random.normal(size=3))
    height, lift = random.uniform(-2.5, 5.0), random.uniform(2.0, 6.0)
    poses = []
    for share in np.linspace(-1.0, 1.0, count).tolist():
        out = rotation_of_vector(share * axis) @ first
        distance = float(tumour.radius_mm(out[None])[0]) + height + lift * share**2
        # The tool points inward: its +z is against the direction, tilted.
        side = np.cross(out, axis)
        side /= np.linalg.norm(side)
        inward = np.stack([side, np.cross(-out, side), -out], axis=1)
        poses.append(Transform(TUMOR_FRAME, TIP_FRAME, tilt @ inward, distance * out))
    return poses


def _jitter(random: np.random.Generator, count: int) -> FloatArray:
    """Jitter (n, 3) of the frames, as multiples of its RMS."""
    kept = math.exp(-1.0 / (RATE_HZ * SLOW_S))
    slow, fresh = np.empty((count, 3)), random.normal(size=(count, 3))
    slow[0] = fresh[0]
    for k in range(1, count):
        slow[k] = kept * slow[k - 1] + math.sqrt(1.0 - kept**2) * fresh[k]
    return np.asarray(slow + random.normal(size=(count, 3)))


def _shifted(pose: Transform, shift: FloatArray) -> Transform:
    return Transform(pose.target, pose.source, pose.rotation, pose.translation_mm + shift)
