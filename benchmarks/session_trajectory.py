"""A recording resampled to any rate: its good samples interpolated, edge by edge."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from app.case import JointSample, TrackingFrame
from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform


class Trajectory:
    """Frames at ``rate_hz`` along the poses and joints of ``recorded``, forwards and backwards.

    Positions and joints are interpolated linearly, rotations along the shortest arc. Times are on
    the recording's clock from its first stamp on and never go back. All values are computed in the
    constructor, so that a frame only costs its own objects.
    """

    def __init__(self, recorded: Sequence[TrackingFrame], rate_hz: int) -> None:
        self._clock = recorded[0].stamp.clock
        self._period_ns = NS_PER_S // rate_hz
        samples: dict[tuple[str, str], list[TrackedTransform]] = {}
        for frame in recorded:
            for sample in frame.poses:
                if sample.status is TrackingStatus.OK:
                    samples.setdefault((sample.target, sample.source), []).append(sample)
        joints = [sample for frame in recorded for sample in frame.joints]
        # Only the time in which all edges and the joints are known: no extrapolation.
        every = [[sample.stamp.ns for sample in edge] for edge in samples.values()]
        every += [[sample.stamp.ns for sample in joints]] if joints else []
        self._start_ns = max(times[0] for times in every)
        times_ns = np.arange(self._start_ns, min(times[-1] for times in every) + 1, self._period_ns)
        self._count = len(times_ns)
        self._edges = {edge: _interpolated(found, times_ns) for edge, found in samples.items()}
        self._joint_names = joints[0].names if joints else ()
        known_ns = np.array([sample.stamp.ns for sample in joints])
        self._joints = np.array(
            [
                np.interp(times_ns, known_ns, [sample.positions[axis] for sample in joints])
                for axis in range(len(self._joint_names))
            ]
        ).T

    def frames(self, count: int) -> Iterator[TrackingFrame]:
        """Yield ``count`` frames."""
        for k in range(count):
            there, back = k % self._count, self._count - 1 - k % self._count
            at = there if (k // self._count) % 2 == 0 else back
            stamp = Stamp(self._start_ns + k * self._period_ns, self._clock)
            yield TrackingFrame(
                stamp,
                tuple(
                    TrackedTransform(
                        Transform.from_quaternion(
                            quaternions[at], positions[at], target=target, source=source
                        ),
                        stamp,
                        TrackingStatus.OK,
                    )
                    for (target, source), (positions, quaternions) in self._edges.items()
                ),
                (JointSample(self._joint_names, self._joints[at], stamp),)
                if self._joint_names
                else (),
            )


def _interpolated(
    samples: list[TrackedTransform], times_ns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 3) in mm and quaternions (n, 4), x y z w, at ``times_ns``."""
    poses = [sample.transform for sample in samples if sample.transform is not None]
    known_ns = np.array([sample.stamp.ns for sample in samples])
    known_mm = np.array([pose.translation_mm for pose in poses])
    positions = [np.interp(times_ns, known_ns, known_mm[:, axis]) for axis in range(3)]
    rotations = Slerp(
        known_ns - known_ns[0], Rotation.from_matrix([pose.rotation for pose in poses])
    )
    return np.column_stack(positions), rotations(times_ns - known_ns[0]).as_quat()
