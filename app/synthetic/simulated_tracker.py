"""A tracker that measures true poses with the errors of its model; the same seed, the same errors.

Nothing here knows of a scenario: a simulation in real time asks for the next acquisition, measures
the poses at its time, and sends them at their stamp.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.geometry import NS_PER_S, FloatArray, Transform
from app.synthetic.motion import Poses
from app.synthetic.tracker_model import TrackerModel

_MAX_TIME_ERROR = 0.3
"""Limit as a share of the period: errors of the interval and both stamps keep stamps rising."""


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
        self._white_scale, self._slow_scale = model.white.deviations, model.slow.deviations
        self._states: dict[str, tuple[float | None, FloatArray]] = {}

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
        metal_mm = None if metal is None else np.array([[metal.start_mm, metal.end_mm]])
        times_s = np.array([time_s])
        (measured,) = self.measure_all((frame,), (Poses.of([truth]),), times_s, metal_mm)
        return measured.transforms()[0]

    def measure_all(
        self,
        frames: Sequence[str],
        truths: Sequence[Poses],
        times_s: FloatArray,
        metal_mm: FloatArray | None = None,
    ) -> tuple[Poses, ...]:
        """Results of `measure` of each of the ``frames`` in turn at each of the ``times_s`` (n,).

        ``truths`` are the n poses of each frame, ``metal_mm`` (n, 2, 3) both ends of the metal.
        """
        from app.synthetic.tracker_kernel import measure_poses  # slow to load

        count, distortion = len(times_s), self._distortion
        if metal_mm is None:
            metal_mm, distortion = np.zeros((count, 2, 3)), self._undistorted
        errors = np.empty((count, len(frames), 1 + self._has_slow, 6))
        if self._has_slow:
            fresh = self._slow_scale * self._slow.standard_normal((count, len(frames), 6))
            for number, frame in enumerate(frames):
                errors[:, number, 0] = self._slow_errors(frame, times_s, fresh[:, number])
        white = self._white.standard_normal((count, len(frames), 6))
        errors[:, :, -1] = self._white_scale * white
        measured = []
        for number, truth in enumerate(truths):
            rotations, positions_mm = np.empty((count, 3, 3)), np.empty((count, 3))
            measure_poses(
                truth.rotations,
                truth.translations_mm,
                metal_mm,
                distortion,
                np.ascontiguousarray(errors[:, number]),
                self._quanta,
                rotations,
                positions_mm,
            )
            if self.model.rotation_digits == "euler" and self.model.rotation_quantum:
                rotations = _rounded_euler(rotations, self.model.rotation_quantum)
            measured.append(Poses(truth.target, truth.source, rotations, positions_mm))
        return tuple(measured)

    def loses(self) -> bool:
        """True if the next sample is marked INVALID by chance."""
        return self.model.lost > 0.0 and bool(self._losses.random() < self.model.lost)

    def lose_all(self, count: int, frames: int) -> NDArray[np.bool_]:
        """Results (n, k) of `loses` for each of ``frames`` in turn, at each of ``count`` times."""
        if self.model.lost <= 0.0:
            return np.zeros((count, frames), np.bool_)
        return np.asarray(self._losses.random((count, frames)) < self.model.lost)

    def _time_error_ns(self, sd_s: float) -> int:
        if not sd_s:
            return 0
        limit_s = _MAX_TIME_ERROR * self.model.period_s
        error_s = min(max(self._times.normal(scale=sd_s), -limit_s), limit_s)
        return round(error_s * NS_PER_S)

    def _slow_errors(self, frame: str, times_s: FloatArray, fresh: FloatArray) -> FloatArray:
        """The exact solution of an Ornstein-Uhlenbeck process at irregular times (n,): (n, 6).

        ``fresh`` (n, 6) are independent errors.
        """
        found = np.array(fresh)
        before_s, before = self._states.get(frame, (None, found[0]))
        for row, time_s in enumerate(times_s.tolist()):
            if before_s is not None:
                kept = np.exp(-(time_s - before_s) / self.model.correlation_s)
                found[row] = kept * before + np.sqrt(1.0 - kept**2) * fresh[row]
            before_s, before = time_s, found[row]
        self._states[frame] = before_s, before
        return found


def _rounded_euler(rotations: FloatArray, quantum_rad: float) -> FloatArray:
    """The rotations (n, 3, 3) with Euler angles rounded to multiples of ``quantum_rad``."""
    angles = Rotation.from_matrix(rotations, assume_valid=True).as_euler("ZYX")
    rounded = np.round(angles / quantum_rad) * quantum_rad
    return np.asarray(Rotation.from_euler("ZYX", rounded).as_matrix())
