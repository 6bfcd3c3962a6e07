"""Which pose pairs of a robot-world calibration agree: the rest is named and dropped."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from app.geometry import FloatArray
from app.registration.errors import NoConsensusError
from app.registration.poses import PoseNoise, PoseStack
from app.registration.robot_world_fit import (
    RobotWorld,
    closed_form,
    maximum_likelihood,
    residuals_of,
    with_estimated_noise,
)

MIN_POSES = 4
"""Three poses determine both transforms and leave nothing to check them by."""

NOMINAL_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""An EM sensor's: where the search for the noise starts when the caller does not know it."""

WRONG_POSE_RATE = 0.01
"""How often, at most, one good pose of a whole set may be called wrong."""

MAX_DRAWS = 200
MAX_REFITS = 20
DRAWN_POSES = 4


def agreeing_poses(
    robot: PoseStack, sensor: PoseStack, noise: PoseNoise | None
) -> tuple[NDArray[np.bool_], RobotWorld, PoseNoise]:
    """Which poses agree (n,), the estimate from them, and the noise that they show."""
    count = len(robot.rotations)
    bound = float(chi2.ppf(1.0 - WRONG_POSE_RATE / count, 6))
    guess = noise or NOMINAL_NOISE
    state = _start(robot, sensor, guess)
    squared = _squared_sigmas(state, robot, sensor, guess)
    if noise is None:
        stretch = math.sqrt(float(np.median(squared)) / float(chi2.median(6)))
        guess = PoseNoise(
            max(guess.rotation_rad * stretch, 1e-9), max(guess.translation_mm * stretch, 1e-7)
        )
        squared = _squared_sigmas(state, robot, sensor, guess)
    # The start comes from a few poses and is rough: the better half is sure to be good.
    good = squared <= max(bound, float(np.median(squared)))
    for _ in range(MAX_REFITS):
        used = robot.of_poses(good), sensor.of_poses(good)
        if noise is None:
            state, guess = with_estimated_noise(*used, state, guess)
        else:
            state = maximum_likelihood(*used, guess, state)
        again = _squared_sigmas(state, robot, sensor, guess) <= bound
        if again.sum() < max(MIN_POSES, count // 2 + 1):
            raise NoConsensusError(
                f"only {int(again.sum())} of {count} poses agree on where the base is: "
                f"at least {max(MIN_POSES, count // 2 + 1)} wanted"
            )
        if np.array_equal(again, good):
            return good, state, guess
        good = again
    raise NoConsensusError(
        f"which of the {count} poses agree did not settle in {MAX_REFITS} rounds"
    )


def _start(robot: PoseStack, sensor: PoseStack, noise: PoseNoise) -> RobotWorld:
    """The closed form of all poses or of the draw of a few that explains half of the poses best.

    Least median of squares over draws (Rousseeuw 1984), with a fixed seed: the same poses give the
    same answer.
    """
    count = len(robot.rotations)
    generator = np.random.default_rng(0)
    draws = [np.ones(count, dtype=bool)]
    if count > DRAWN_POSES + 1:
        for _ in range(MAX_DRAWS):
            mask = np.zeros(count, dtype=bool)
            mask[generator.choice(count, DRAWN_POSES, replace=False)] = True
            draws.append(mask)
    candidates = [closed_form(robot.of_poses(draw), sensor.of_poses(draw)) for draw in draws]
    scores = [
        float(np.median(_squared_sigmas(state, robot, sensor, noise))) for state in candidates
    ]
    return candidates[int(np.argmin(scores))]


def _squared_sigmas(
    state: RobotWorld, robot: PoseStack, sensor: PoseStack, noise: PoseNoise
) -> FloatArray:
    return np.asarray(np.sum((residuals_of(state, robot, sensor) / noise.sigmas) ** 2, axis=1))
