"""What is recorded of a simulation: frames with the tracker's errors, joints, and what was lost."""

from collections.abc import Iterator, Sequence

import numpy as np

from app.case.frames.samples import JointSample, TrackingFrame
from app.case.manifest.expected import DropoutKind, ExpectedDropout
from app.geometry import NS_PER_S, Stamp, TrackedTransform, TrackingStatus
from app.synthetic.case_errors import Encoders
from app.synthetic.simulated_tracker import Reading, SimulatedTracker
from app.synthetic.simulation import (
    FIRST_STAMP_NS,
    JOINT_PERIOD_NS,
    ROBOT_TO_TRACKER_OFFSET_NS,
    TRACKED_FRAMES,
    Simulation,
)
from app.synthetic.tracker import reported


class Recording:
    """Yields the recorded frames of a simulation once, and knows afterwards what they lack.

    ``offset_ns`` is what the case adds to the robot's clock; the true offset is
    `ROBOT_TO_TRACKER_OFFSET_NS`, and the tracker's stamps are late by its latency.
    """

    def __init__(
        self,
        simulation: Simulation,
        tracker: SimulatedTracker,
        *,
        encoders: Encoders | None = None,
        offset_ns: int = ROBOT_TO_TRACKER_OFFSET_NS,
    ) -> None:
        self._simulation, self._tracker = simulation, tracker
        self._encoders, self._offset_ns = encoders, offset_ns
        self._first_ns: int | None = None
        self._losses = {frame: _Losses(frame) for frame in TRACKED_FRAMES}
        self._before: dict[str, TrackedTransform] = {}

    def frames(self) -> Iterator[TrackingFrame]:
        """Yield the frames, each with the joints read since the last.

        A frame without any sample is left out, and its joints come with the next one.
        """
        joints: list[JointSample] = []
        joint_ns = (FIRST_STAMP_NS - self._offset_ns) // JOINT_PERIOD_NS * JOINT_PERIOD_NS
        for reading in self._tracker.readings(self._simulation.duration_s):
            stamp = Stamp(FIRST_STAMP_NS + reading.stamp_ns)
            if self._first_ns is None:
                self._first_ns = stamp.ns
                joint_ns = (stamp.ns - self._offset_ns) // JOINT_PERIOD_NS * JOINT_PERIOD_NS
            read_ns = range(joint_ns, stamp.ns - self._offset_ns + 1, JOINT_PERIOD_NS)
            joints.extend(self._joint_samples(read_ns))
            joint_ns += len(read_ns) * JOINT_PERIOD_NS
            poses = self._measure(reading, stamp)
            if poses:
                yield TrackingFrame(stamp, poses, tuple(joints))
                joints = []

    def recorded_s(self, time_s: float) -> float:
        """The time in the recording, from its first stamp, of a true time; after `frames`."""
        assert self._first_ns is not None
        late_s = self._tracker.model.latency_s - (self._first_ns - FIRST_STAMP_NS) / NS_PER_S
        return time_s + late_s

    def dropouts(self, stale_after_s: float) -> tuple[ExpectedDropout, ...]:
        """The intervals without a usable pose, in order; after `frames`.

        Samples marked invalid are known at once, so the dropout begins with the first of them.
        Missing samples are known by the age of the last received one, so it begins with that, and
        only one of more than ``stale_after_s`` is a dropout.
        """
        assert self._first_ns is not None
        found = []
        for rank, losses in enumerate(self._losses.values()):
            for kind, start_ns, end_ns in losses.spans():
                start_s, end_s = ((ns - self._first_ns) / NS_PER_S for ns in (start_ns, end_ns))
                if kind == "invalid" or end_s - start_s > stale_after_s:
                    found.append(
                        (start_s, rank, ExpectedDropout(losses.frame, kind, start_s, end_s))
                    )
        return tuple(dropout for *_, dropout in sorted(found, key=lambda entry: entry[:2]))

    def _measure(self, reading: Reading, stamp: Stamp) -> tuple[TrackedTransform, ...]:
        time_s = reading.acquired_ns / NS_PER_S
        metal = self._simulation.metal(time_s)
        arrived = []
        for frame in TRACKED_FRAMES:
            truth = self._simulation.tracker_from(frame, time_s)
            measured = self._tracker.measure(frame, truth, time_s, metal)
            sample = TrackedTransform(measured, stamp, TrackingStatus.OK)
            if reading.repeated and frame in self._before:
                before = self._before[frame].transform
                assert before is not None
                sample = TrackedTransform(before, stamp, TrackingStatus.OK)
            self._before[frame] = sample
            received = reported(sample, self._simulation.scenario.dropouts, time_s)
            lost = self._tracker.loses()
            if received is not None and lost and not reading.skipped:
                received = TrackedTransform.lost(
                    sample.target, frame, stamp, TrackingStatus.INVALID
                )
            if reading.skipped:
                received = None
            self._losses[frame].add(stamp.ns, None if received is None else received.status)
            if received is not None:
                arrived.append(received)
        return tuple(arrived)

    def _joint_samples(self, robot_ns: Sequence[int]) -> Iterator[JointSample]:
        """The samples at these times of the robot's clock."""
        motion = self._simulation.arm_motion
        late_ns = ROBOT_TO_TRACKER_OFFSET_NS - FIRST_STAMP_NS
        positions = motion.positions(np.array([(ns + late_ns) / NS_PER_S for ns in robot_ns]))
        if self._encoders is not None:
            positions = self._encoders.read(positions)
        for ns, row in zip(robot_ns, positions.tolist(), strict=True):
            yield JointSample(motion.joint_names, tuple(row), Stamp(ns, "robot"))


class _Losses:
    """Spans without a usable sample of one sensor."""

    def __init__(self, frame: str) -> None:
        self.frame = frame
        self._spans: list[tuple[DropoutKind, int, int]] = []
        self._open: tuple[DropoutKind, int, int] | None = None
        self._received_ns = 0

    def add(self, stamp_ns: int, status: TrackingStatus | None) -> None:
        """Add the sample of ``stamp_ns``; None if it did not arrive."""
        kind: DropoutKind = "missing" if status is None else "invalid"
        if status is TrackingStatus.OK:
            self._close()
        elif self._open is not None and self._open[0] == kind:
            self._open = (kind, self._open[1], stamp_ns)
        else:
            self._close()
            start_ns = stamp_ns if status is not None else self._received_ns
            self._open = (kind, start_ns, stamp_ns)
        if status is not None:
            self._received_ns = stamp_ns

    def spans(self) -> list[tuple[DropoutKind, int, int]]:
        """All spans as kind, start and end."""
        self._close()
        return self._spans

    def _close(self) -> None:
        if self._open is not None:
            self._spans.append(self._open)
            self._open = None
