"""Time parameterisation of a path: from rest to rest on each straight part, with limited jerk.

The arm stops at each via state. So it stays on the path that was checked, and the jerk is limited,
at the price of time: a blend at a corner would leave the path.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError
from app.robot import Robot

SAMPLE_NS = 10_000_000
"""Time between two samples of a trajectory."""

MAX_DURATION_S = 600.0
"""Longest trajectory."""

MAX_SHOWN = 81
"""Samples of a trajectory that displays show."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Largest acceleration and jerk of a joint, and velocity, in rad, for sliding joints in m.

    ``velocity`` is needed where the robot's file gives none; of two the smaller one holds.
    """

    acceleration: float
    jerk: float
    velocity: float | None = None

    def __post_init__(self) -> None:
        for name in ("acceleration", "jerk", "velocity"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} limit: is {value}; expected a number above 0")


def shown_samples(count: int) -> NDArray[np.intp]:
    """Numbers of `MAX_SHOWN` of ``count`` samples, or of all, the first and the last among them."""
    shown = np.linspace(0, count - 1, min(count, MAX_SHOWN))
    return np.unique(shown.round().astype(np.intp))


def limit_rows(
    robot: Robot, joints: Sequence[str], limits: Mapping[str, MotionLimits]
) -> FloatArray:
    """Velocity, acceleration and jerk (3, d) of ``joints``; raises `InputError` without limits."""
    rows = []
    for name in joints:
        if name not in limits:
            raise InputError(f"joint {name!r}: has no acceleration and jerk limit; expected both")
        given, of_drive = limits[name], robot.tree.joint(name).dynamics.velocity
        velocities = [each for each in (given.velocity, of_drive) if each is not None]
        if not velocities or not min(velocities) > 0.0:
            raise InputError(
                f"joint {name!r}: has no velocity limit above 0 in the robot's file and none is "
                "given; expected one"
            )
        rows.append((min(velocities), given.acceleration, given.jerk))
    return np.array(rows).T


def time_path(
    states: FloatArray, limits: FloatArray, is_over: Callable[[], bool] = lambda: False
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Times (n,) in ns from 0, positions (n, d) and velocities (n, d) along ``states`` (k, d).

    ``limits`` (3, d) are those of `limit_rows`. The samples are `SAMPLE_NS` apart; each part takes
    a whole number of them, so that every via state is a sample and a straight line between two
    samples is on the path. Raises `InputError` for limits that give no motion, or one of more than
    `MAX_DURATION_S`, and when ``is_over``, which is asked at each part.
    """
    positions, velocities, count = [states[:1]], [np.zeros((1, states.shape[1]))], 1
    for start, end in pairwise(states):
        if is_over():
            raise InputError("path: its timing was ended; expected the time for it")
        change = end - start
        if not change.any():
            continue
        left_s = MAX_DURATION_S - count * SAMPLE_NS * 1e-9
        along, speed = _rest_to_rest(np.abs(change), limits, left_s)
        count += len(along)
        positions.append(start + along[:, None] * change)
        positions[-1][-1] = end
        velocities.append(speed[:, None] * change)
        velocities[-1][-1] = 0.0
    times_ns = SAMPLE_NS * np.arange(count, dtype=np.int64)
    return times_ns, np.concatenate(positions), np.concatenate(velocities)


def _rest_to_rest(
    change: FloatArray, limits: FloatArray, left_s: float
) -> tuple[FloatArray, FloatArray]:
    """Fraction (n,) of a straight part at the samples after its start, and its rate (n,) per s."""
    moving = change > 0.0
    import ruckig  # of an extra

    otg = ruckig.Ruckig(1)
    parameters = ruckig.InputParameter(1)
    parameters.target_position = [1.0]
    # A share of the part per second that no joint exceeds.
    most = (limits[:, moving] / change[moving]).min(axis=1).tolist()
    parameters.max_velocity, parameters.max_acceleration, parameters.max_jerk = (
        [value] for value in most
    )
    trajectory = ruckig.Trajectory(1)
    try:
        otg.calculate(parameters, trajectory)
    except ruckig.RuckigError:  # its text has many lines
        raise InputError(f"motion limits: {most} give no motion; expected larger ones") from None
    if not trajectory.duration <= left_s:
        raise InputError(
            f"motion limits: a part of the way takes {trajectory.duration:.4g} s; expected larger "
            f"ones, with which the whole way takes at most {MAX_DURATION_S:g} s"
        )
    sample_s = SAMPLE_NS * 1e-9
    count = max(1, math.ceil(trajectory.duration / sample_s))
    slower = trajectory.duration / (count * sample_s)
    samples = [trajectory.at_time(slower * sample_s * number)[:2] for number in range(1, count + 1)]
    along, speed = np.array(samples)[:, :, 0].T
    return along, slower * speed
