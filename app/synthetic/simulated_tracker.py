"""A tracker that measures true poses with the errors of its model; the same seed, the same errors.

Nothing here knows of a scenario: a simulation in real time asks for the next acquisition, measures
the poses at its time, and sends them at their stamp.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import NS_PER_S, FloatArray, Transform
from app.synthetic.tracker_model import TrackerModel

_MAX_TIME_ERROR = 0.3
"""Of the period: errors of the interval and of both stamps together keep stamps rising."""


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
        # What the kernel reads: only the pose, the metal and the errors differ between samples.
        bend, quanta = model.distortion, [model.position_quantum_mm, 0.0]
        if model.rotation_digits == "quaternion":
            quanta[1] = model.rotation_quantum
        self._distortion = np.array([bend.shift_mm, bend.turn_rad, bend.reach_mm])
        self._undistorted = np.array([0.0, 0.0, bend.reach_mm])
        self._quanta = np.array(quanta)
        self._has_slow = bool(model.slow.position_rms_mm or model.slow.angle_rms_rad)
        self._pose, self._metal_mm = np.empty((3, 4)), np.zeros((2, 3))
        self._errors = np.empty((1 + self._has_slow, 6))
        self._white_scale, self._slow_scale = model.white.deviations, model.slow.deviations
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
        pose, distortion = self._pose, self._undistorted
        pose[:, :3], pose[:, 3] = truth.rotation, truth.translation_mm
        if metal is not None:
            distortion = self._distortion
            self._metal_mm[0], self._metal_mm[1] = metal.start_mm, metal.end_mm
        if self._has_slow:
            self._errors[0] = self._slow_error(frame, time_s)
        self._errors[-1] = self._white_scale * self._white.standard_normal(6)
        rotation, position = np.empty((3, 3)), np.empty(3)
        measure = _load_kernel()
        measure(pose, self._metal_mm, distortion, self._errors, self._quanta, rotation, position)
        if self.model.rotation_digits == "euler" and self.model.rotation_quantum:
            rotation = _rounded_euler(rotation, self.model.rotation_quantum)
        return Transform.unchecked(truth.target, truth.source, rotation, position)

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
        fresh = self._slow_scale * self._slow.standard_normal(6)
        if frame in self._states:
            before_s, before = self._states[frame]
            kept = np.exp(-(time_s - before_s) / model.correlation_s)
            fresh = kept * before + np.sqrt(1.0 - kept**2) * fresh
        self._states[frame] = (time_s, fresh)
        return np.asarray(fresh)


def _rounded_euler(rotation: FloatArray, quantum_rad: float) -> FloatArray:
    """The rotation (3, 3) whose Euler angles are rounded to multiples of ``quantum_rad``."""
    angles = Rotation.from_matrix(rotation, assume_valid=True).as_euler("ZYX")
    rounded = np.round(angles / quantum_rad) * quantum_rad
    return np.asarray(Rotation.from_euler("ZYX", rounded).as_matrix())


@cache
def _load_kernel() -> Callable[..., Any]:
    from app.synthetic.tracker_kernel import measure_pose

    return measure_pose
