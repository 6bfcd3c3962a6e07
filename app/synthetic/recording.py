"""Recording of a simulation: frames with the tracker's errors, joints, and what was lost."""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from app.case.frame_streams import JointSample, TrackingFrame
from app.case.manifest.expected import DropoutKind, ExpectedDropout
from app.geometry import NS_PER_S, Stamp, TrackedTransform, TrackingStatus, Transform
from app.synthetic.case_options import Encoders
from app.synthetic.simulated_tracker import Reading, SimulatedTracker
from app.synthetic.simulation import (
    FIRST_STAMP_NS,
    JOINT_PERIOD_NS,
    ROBOT_TO_TRACKER_OFFSET_NS,
    TRACKED_FRAMES,
    Simulation,
)
from app.synthetic.tracker_model import reported

_BLOCK = 2000
"""Readings that are measured at once."""


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
        self._before: dict[str, Transform] = {}
        self._joint_number = 0  # of the next sample, in periods of the robot's clock

    def frames(self) -> Iterator[TrackingFrame]:
        """Yield the frames, each with the joints read since the last.

        A frame without any sample is left out, and its joints come with the next one.
        """
        joints: list[JointSample] = []
        readings = self._tracker.readings(self._simulation.duration_s)
        while block := list(islice(readings, _BLOCK)):
            samples = self._joint_samples(block)
            for reading, poses in zip(block, self._measured(block), strict=True):
                stamp = Stamp(FIRST_STAMP_NS + reading.stamp_ns)
                until_ns = stamp.ns - self._offset_ns
                while samples and samples[0].stamp.ns <= until_ns:
                    joints.append(samples.popleft())
                received = self._received(reading, stamp, *poses)
                if received:
                    yield TrackingFrame(stamp, received, tuple(joints))
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

    def _measured(
        self, readings: Sequence[Reading]
    ) -> Iterator[tuple[tuple[Transform, ...], list[bool]]]:
        """The measured poses of all frames at each reading, and which are lost by chance."""
        times_s = np.array([reading.acquired_ns / NS_PER_S for reading in readings])
        truths, metal_mm = self._simulation.tracked(times_s)
        measured = self._tracker.measure_all(TRACKED_FRAMES, truths, times_s, metal_mm)
        lost = self._tracker.lose_all(len(readings), len(TRACKED_FRAMES))
        transforms = zip(*(poses.transforms() for poses in measured), strict=True)
        return zip(transforms, lost.tolist(), strict=True)

    def _received(
        self, reading: Reading, stamp: Stamp, measured: Sequence[Transform], lost: Sequence[bool]
    ) -> tuple[TrackedTransform, ...]:
        time_s = reading.acquired_ns / NS_PER_S
        arrived = []
        for frame, pose, is_lost in zip(TRACKED_FRAMES, measured, lost, strict=True):
            if reading.repeated and frame in self._before:
                pose = self._before[frame]
            self._before[frame] = pose
            sample = TrackedTransform.valid(pose, stamp)
            received = reported(sample, self._simulation.scenario.dropouts, time_s)
            if received is not None and is_lost and not reading.skipped:
                received = TrackedTransform.lost(
                    sample.target, frame, stamp, TrackingStatus.INVALID
                )
            if reading.skipped:
                received = None
            self._losses[frame].add(stamp.ns, None if received is None else received.status)
            if received is not None:
                arrived.append(received)
        return tuple(arrived)

    def _joint_samples(self, readings: Sequence[Reading]) -> deque[JointSample]:
        """The samples since the last ones, up to the last of these readings."""
        first_ns, last_ns = (
            (FIRST_STAMP_NS + readings[index].stamp_ns - self._offset_ns) // JOINT_PERIOD_NS
            for index in (0, -1)
        )
        if self._first_ns is None:
            self._first_ns = FIRST_STAMP_NS + readings[0].stamp_ns
            self._joint_number = first_ns
        robot_ns = [number * JOINT_PERIOD_NS for number in range(self._joint_number, last_ns + 1)]
        self._joint_number += len(robot_ns)
        motion = self._simulation.arm_motion
        late_ns = ROBOT_TO_TRACKER_OFFSET_NS - FIRST_STAMP_NS
        positions = motion.positions(np.array([(ns + late_ns) / NS_PER_S for ns in robot_ns]))
        if self._encoders is not None:
            positions = self._encoders.read(positions)
        return deque(
            JointSample(motion.joint_names, tuple(row), Stamp(ns, "robot"))
            for ns, row in zip(robot_ns, positions.tolist(), strict=True)
        )


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
