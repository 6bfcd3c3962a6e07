"""The frames that a reader yields of a recording, without writing and reading its file."""

from collections.abc import Sequence

import numpy as np

from app.case.frames.samples import JointSample, TrackingFrame
from app.case.messages.cdr_batch import pose_arrays
from app.case.messages.values import MM_PER_M
from app.geometry import (
    InputError,
    Stamp,
    TrackedTransform,
    Transform,
    quaternions_of_rotations,
)


def frames_as_read(
    frames: Sequence[TrackingFrame], *, robot_to_tracker_offset_ns: int = 0
) -> tuple[TrackingFrame, ...]:
    """The frames that `Case.recorded_frames` yields of what `Recorder` writes of ``frames``.

    Poses have the rounding of messages: metres and quaternions. Joint stamps are moved to the
    tracker's clock by the offset. Raises `InputError` unless stamps rise from frame to frame and
    each frame has poses, at its stamp; joints must not be later than their frame.
    """
    measured = []
    before_ns: int | None = None
    for frame in frames:
        if not frame.poses or (before_ns is not None and frame.stamp.ns <= before_ns):
            raise InputError(
                f"frame at {frame.stamp.ns} ns has {len(frame.poses)} poses; expected poses, and "
                "stamps that rise"
            )
        before_ns = frame.stamp.ns
        measured += [sample.transform for sample in frame.poses if sample.transform is not None]
    read = iter(_poses_as_read(measured))
    return tuple(
        TrackingFrame(
            frame.stamp,
            tuple(
                sample
                if sample.transform is None
                else TrackedTransform.valid(next(read), sample.stamp)
                for sample in frame.poses
            ),
            tuple(_moved(sample, robot_to_tracker_offset_ns) for sample in frame.joints),
            frame.unfiltered_stamp,
        )
        for frame in frames
    )


def _poses_as_read(transforms: Sequence[Transform]) -> list[Transform]:
    if not transforms:
        return []
    positions_m = np.array([each.translation_mm for each in transforms]) / MM_PER_M
    quaternions = quaternions_of_rotations(np.array([each.rotation for each in transforms]))
    translations_mm, rotations, _ = pose_arrays(positions_m, quaternions)
    return [
        Transform.of_read_only(each.target, each.source, rotation, translation_mm)
        for each, rotation, translation_mm in zip(
            transforms, rotations, translations_mm, strict=True
        )
    ]


def _moved(sample: JointSample, offset_ns: int) -> JointSample:
    if sample.stamp.clock == "tracker":
        return sample
    return JointSample.unchecked(
        sample.names, sample.positions, Stamp.of_ns(sample.stamp.ns + offset_ns)
    )
