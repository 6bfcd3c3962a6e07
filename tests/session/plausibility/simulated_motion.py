"""Frames of a simulated operation of any length, with the disturbances of real trackers."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from app.case import JointSample, TrackingFrame
from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, Transform
from app.synthetic.motion import TouchArm
from app.synthetic.simulation import TRACKED_FRAMES, simulate

SEED = 1
"""Seed of the shipped case, whose registration then fits."""

_FIRST_NS = 1_000 * NS_PER_S


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Errors of a tracker: RMS noise in mm and degrees, stamps, quantisation, missing samples.

    ``stamp_ms``: largest error of a stamp. ``missing``: share of samples that never arrive.
    """

    noise: float = 0.3
    stamp_ms: float = 0.0
    quantum_mm: float = 0.0
    missing: float = 0.0


DISTURBANCES = (
    Disturbance(),
    Disturbance(stamp_ms=4.0),
    Disturbance(quantum_mm=0.5),
    Disturbance(missing=0.05),
    Disturbance(noise=0.6),  # 1.0 exceeds max_drift_deg of the case: single differences hold
    Disturbance(noise=0.5, stamp_ms=4.0, quantum_mm=0.1, missing=0.02),
)


class SimulatedMotion:
    """The motion of the simulated lumpectomy, there and back, as often as needed.

    Poses are computed once at ``rate_hz``; frames have this rate divided by an integer, and every
    frame has new errors.
    """

    def __init__(self, rate_hz: int) -> None:
        self.rate_hz = rate_hz
        arm = TouchArm()
        simulation = simulate(arm, np.random.default_rng([SEED, 0]))
        times = np.arange(0.0, simulation.duration_s, 1.0 / rate_hz).tolist()
        self.count = len(times)
        self._joint_names = simulation.arm_motion.joint_names
        self._joints = [tuple(simulation.arm_motion.positions(t).tolist()) for t in times]
        self._poses = {
            frame: [simulation.tracker_from(frame, t) for t in times] for frame in TRACKED_FRAMES
        }

    def frames(
        self,
        seconds: float,
        disturbance: Disturbance,
        random: np.random.Generator,
        *,
        first: int = 0,
        rate_hz: int = 50,
        start_ns: int = _FIRST_NS,
    ) -> Iterator[TrackingFrame]:
        """Yield frames from pose number ``first`` on."""
        every = self.rate_hz // rate_hz
        period_ns = every * NS_PER_S // self.rate_hz
        before_ns = 0
        for number in range(round(seconds * rate_hz)):
            if random.random() < disturbance.missing:
                continue
            at = self._index(first + number * every)
            error_ns = round(random.uniform(-1.0, 1.0) * disturbance.stamp_ms * 1e6)
            true_ns = start_ns + number * period_ns
            stamp = Stamp(max(true_ns + error_ns, before_ns + 1))
            before_ns = stamp.ns
            poses = tuple(
                TrackedTransform.valid(_measured(poses[at], disturbance, random), stamp)
                for poses in self._poses.values()
            )
            joints_ns = min(true_ns, stamp.ns)
            joints = JointSample.unchecked(self._joint_names, self._joints[at], Stamp(joints_ns))
            yield TrackingFrame(stamp, poses, (joints,))

    def _index(self, number: int) -> int:
        there_and_back = 2 * self.count - 2
        number %= there_and_back
        return number if number < self.count else there_and_back - number


def _measured(truth: Transform, disturbance: Disturbance, random: np.random.Generator) -> Transform:
    errors = random.normal(scale=disturbance.noise / np.sqrt(3.0), size=6)
    turn = Rotation.from_rotvec(np.deg2rad(errors[3:])).as_matrix()
    position: FloatArray = truth.translation_mm + errors[:3]
    if disturbance.quantum_mm:
        position = np.round(position / disturbance.quantum_mm) * disturbance.quantum_mm
    return Transform.unchecked(truth.target, truth.source, truth.rotation @ turn, position)
