"""Writes tracker frames to an MCAP recording that any ROS 2 machine can read.

Topics: every sample on ``/tracked_transforms``, valid samples on ``/tf`` too, joints on
``/joint_states``, and the second clock of a frame, where it has one, as a TimeReference. The log
time of a message is its acquisition time, so that the file plays in the order of events.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import numpy as np
from mcap.writer import CompressionType, Writer

from app.case.frame_streams import JointSample, TrackingFrame
from app.case.messages.cdr_batch import pose_arrays
from app.case.messages.message_values import MM_PER_M
from app.case.messages.ros_messages import (
    JOINT_STATE,
    JOINT_STATES_TOPIC,
    TF_MESSAGE,
    TF_TOPIC,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORMS_TOPIC,
    UNFILTERED_TIME_TOPIC,
    joint_state_bytes,
    ros_types,
    tf_bytes,
    time_reference_message,
    tracked_transform_bytes,
)
from app.files.atomic_io import writing
from app.geometry import (
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    quaternions_of_rotations,
)

_CHUNK_BYTES = 128 * 1024
"""A crash loses the chunk that is being filled: about a second at 50 Hz."""


class Recorder:
    """Writes an MCAP file, which appears under its name only after a close without an error.

    ``robot_to_tracker_offset_ns`` is subtracted from the stamps of joint samples on the tracker's
    clock, so that the file holds the robot's own stamps. The same frames give the same bytes.
    """

    def __init__(
        self,
        path: Path,
        *,
        robot_to_tracker_offset_ns: int = 0,
        joint_states_topic: str = JOINT_STATES_TOPIC,
    ) -> None:
        self._path = path
        self._partial = path.with_name(f".{path.name}.partial")
        self._offset_ns = robot_to_tracker_offset_ns
        self._topics: Mapping[str, str] = {
            TRACKED_TRANSFORMS_TOPIC: TRACKED_TRANSFORM,
            TF_TOPIC: TF_MESSAGE,
            joint_states_topic: JOINT_STATE,
            UNFILTERED_TIME_TOPIC: TIME_REFERENCE,
        }
        self._joint_states_topic = joint_states_topic
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def __enter__(self) -> Self:
        if self._path.exists():
            raise InputError(f"{self._path} already exists; refusing to overwrite it")
        with writing(self._path):
            self._file: IO[bytes] = self._partial.open("wb")
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="marginguard")
        for topic, message_type in self._topics.items():
            definition, _ = ros_types().generate_msgdef(message_type, ros_version=2)
            schema = self._writer.register_schema(message_type, "ros2msg", definition.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._writer.finish()  # type: ignore[no-untyped-call]
        except BaseException:
            self._file.close()
            self._partial.unlink()
            raise
        self._file.close()
        if kind is None:
            self._partial.replace(self._path)
        else:
            self._partial.unlink()

    def write(self, frame: TrackingFrame) -> None:
        """Append a frame; frames are written in the order of acquisition."""
        for joints in frame.joints:
            self._write_joints(joints)
        for sample in frame.poses:
            data = tracked_transform_bytes(sample)
            self._add(TRACKED_TRANSFORMS_TOPIC, sample.stamp.ns, data)
        valid = [sample for sample in frame.poses if sample.status is TrackingStatus.OK]
        if valid:
            self._add(TF_TOPIC, frame.stamp.ns, tf_bytes(valid))
        if frame.unfiltered_stamp is not None:
            message = time_reference_message(frame.stamp, frame.unfiltered_stamp)
            data = bytes(ros_types().serialize_cdr(message, TIME_REFERENCE))
            self._add(UNFILTERED_TIME_TOPIC, frame.stamp.ns, data)

    def _write_joints(self, sample: JointSample) -> None:
        robot_ns = sample.stamp.ns
        if sample.stamp.clock == "tracker":
            robot_ns -= self._offset_ns
        data = joint_state_bytes(sample, robot_ns)
        self._add(self._joint_states_topic, robot_ns + self._offset_ns, data)

    def _add(self, topic: str, log_ns: int, data: bytes) -> None:
        if not 0 <= log_ns < 2**63:
            raise InputError(f"stamp to record is {log_ns} ns; expected 0 to 2^63 - 1")
        sequence = self._counts[topic] = self._counts.get(topic, -1) + 1
        self._writer.add_message(
            self._channels[topic], log_ns, data, publish_time=log_ns, sequence=sequence
        )


def write_recording(
    path: Path,
    frames: Iterable[TrackingFrame],
    *,
    robot_to_tracker_offset_ns: int = 0,
    joint_states_topic: str = JOINT_STATES_TOPIC,
) -> None:
    """Write all ``frames`` to the MCAP file ``path``; no file is left after an error.

    Raises `InputError` when ``path`` exists or cannot be written, or a stamp does not fit.
    """
    with Recorder(
        path,
        robot_to_tracker_offset_ns=robot_to_tracker_offset_ns,
        joint_states_topic=joint_states_topic,
    ) as recorder:
        for frame in frames:
            recorder.write(frame)


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
