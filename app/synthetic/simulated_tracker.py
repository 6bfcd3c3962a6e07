"""A tracker that measures true poses with the errors of its model; the same seed, the same errors.

Nothing here knows of a scenario: a simulation in real time asks for the next acquisition, measures
the poses at its time, and sends them at their stamp.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import NS_PER_S, FloatArray, Transform
from app.geometry.rotation_vectors import (
    canonical_quaternion,
    rotation_of_digits,
    rotation_of_vector,
)
from app.synthetic.tracker_model import TrackerModel

_MAX_TIME_ERROR = 0.3
"""Of the period: errors of the interval and of both stamps together keep stamps rising."""

_SOFT_MM = 1.0
"""The direction away from the metal is smooth within this distance of it."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One answer of the tracker, in ns from its first acquisition.

    ``stamp_ns`` is in the recording, ``acquired_ns`` is when the poses were measured. ``skipped``:
    it never arrives. ``repeated``: it holds the poses of the one before.
    """

    acquired_ns: int
    stamp_ns: int
    skipped: bool = False
    repeated: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Metal:
    """A straight piece of metal in the tracker's frame, between two points (3,) in mm."""

    start_mm: FloatArray
    end_mm: FloatArray

    def nearest(self, point_mm: FloatArray) -> FloatArray:
        """The nearest point (3,) of it."""
        along = self.end_mm - self.start_mm
        share = float((point_mm - self.start_mm) @ along) / max(float(along @ along), 1e-12)
        return np.asarray(self.start_mm + min(max(share, 0.0), 1.0) * along)


class SimulatedTracker:
    """Applies a `TrackerModel`; keeps the state of its correlated noise, one for each sensor.

    ``seed``: non-negative integers. Noise, times and losses are drawn from streams of their own, so
    that changing one of them leaves the others as they are.
    """

    def __init__(self, model: TrackerModel, seed: Sequence[int]) -> None:
        self.model = model
        self._white = np.random.default_rng(list(seed))
        self._slow, self._times, self._losses = (
            np.random.default_rng([*seed, stream]) for stream in (1, 2, 3)
        )
        slow = model.slow
        self._slow_scale = np.repeat(
            [slow.position_rms_mm / np.sqrt(3.0), slow.angle_rms_rad / np.sqrt(3.0)], 3
        )
        self._states: dict[str, tuple[float, FloatArray]] = {}

    def readings(self, duration_s: float) -> Iterator[Reading]:
        """Yield all readings with an acquisition from 0 to ``duration_s``, in order."""
        model, end_ns = self.model, round(duration_s * NS_PER_S)
        period_ns = round(NS_PER_S / model.rate_hz)
        acquired_ns, first = 0, True
        while acquired_ns <= end_ns:
            stamp_ns = acquired_ns + round(model.latency_s * NS_PER_S)
            stamp_ns += self._time_error_ns(model.stamp_sd_s)
            skipped, repeated = (
                not first and share > 0.0 and bool(self._times.random() < share)
                for share in (model.skipped, model.repeated)
            )
            yield Reading(acquired_ns, stamp_ns, skipped, repeated)
            acquired_ns += period_ns + self._time_error_ns(model.period_sd_s)
            first = False

    def measure(
        self, frame: str, truth: Transform, time_s: float, metal: Metal | None = None
    ) -> Transform:
        """The pose that the tracker reports of the sensor ``frame``, acquired at ``time_s``.

        ``truth`` is its pose in the tracker. Times of one sensor must not fall.
        """
        model, pose = self.model, truth
        if metal is not None and (model.distortion.shift_mm or model.distortion.turn_rad):
            pose = self._distorted(pose, metal)
        if model.slow.position_rms_mm or model.slow.angle_rms_rad:
            pose = _moved(pose, self._slow_error(frame, time_s))
        return self._rounded(model.white.measured(pose, self._white))

    def loses(self) -> bool:
        """True if the next sample is marked INVALID by chance."""
        return self.model.lost > 0.0 and bool(self._losses.random() < self.model.lost)

    def _time_error_ns(self, sd_s: float) -> int:
        if not sd_s:
            return 0
        limit_s = _MAX_TIME_ERROR * self.model.period_s
        error_s = min(max(self._times.normal(scale=sd_s), -limit_s), limit_s)
        return round(error_s * NS_PER_S)

    def _slow_error(self, frame: str, time_s: float) -> FloatArray:
        """The exact solution of an Ornstein-Uhlenbeck process at irregular times (6,)."""
        model = self.model
        fresh = self._slow_scale * self._slow.normal(size=6)
        if frame in self._states:
            before_s, before = self._states[frame]
            kept = np.exp(-(time_s - before_s) / model.correlation_s)
            fresh = kept * before + np.sqrt(1.0 - kept**2) * fresh
        self._states[frame] = (time_s, fresh)
        return np.asarray(fresh)

    def _distorted(self, pose: Transform, metal: Metal) -> Transform:
        distortion = self.model.distortion
        away = pose.translation_mm - metal.nearest(pose.translation_mm)
        distance_mm = math.sqrt(float(away @ away))
        away = away / np.hypot(distance_mm, _SOFT_MM)
        along = metal.end_mm - metal.start_mm
        axis = _cross(along / max(math.sqrt(float(along @ along)), 1e-12), away)
        share = distortion.share(distance_mm)
        turn = pose.rotation.T @ axis * (distortion.turn_rad * share)
        return _moved(pose, np.concatenate([distortion.shift_mm * share * away, turn]))

    def _rounded(self, pose: Transform) -> Transform:
        model = self.model
        position, rotation = pose.translation_mm, pose.rotation
        if model.position_quantum_mm:
            position = _multiple(position, model.position_quantum_mm)
        if model.rotation_digits != "exact" and model.rotation_quantum:
            if model.rotation_digits == "quaternion":
                numbers = _multiple(canonical_quaternion(rotation), model.rotation_quantum)
                rotation = rotation_of_digits(numbers)
            else:
                turn = Rotation.from_matrix(rotation, assume_valid=True)
                angles = _multiple(turn.as_euler("ZYX"), model.rotation_quantum)
                rotation = Rotation.from_euler("ZYX", angles).as_matrix()
        return Transform.unchecked(pose.target, pose.source, rotation, position)


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """The cross product (3,): `numpy.cross` takes ten times as long for two vectors."""
    (a, b, c), (d, e, f) = first.tolist(), second.tolist()
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])


def _multiple(values: FloatArray, quantum: float) -> FloatArray:
    return np.asarray(np.round(values / quantum) * quantum)


def _moved(pose: Transform, error: FloatArray) -> Transform:
    """``pose`` displaced by ``error[:3]`` (mm), and turned about the sensor by ``error[3:]``."""
    turn = rotation_of_vector(error[3:])
    return Transform.unchecked(
        pose.target, pose.source, pose.rotation @ turn, pose.translation_mm + error[:3]
    )
