"""Values of a ROS message as plain numbers, and the samples that are made of them."""

import math
from typing import Any, NamedTuple

import numpy as np

from app.case.frames.samples import JointSample
from app.geometry import (
    NS_PER_S,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    rotation_of_quaternion,
)

MM_PER_M = 1000.0


class PoseValues(NamedTuple):
    """A stamped transform in the numbers of its message: metres, quaternion as x, y, z, w."""

    target: str
    source: str
    ns: int
    translation_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    status: int = int(TrackingStatus.OK)

    @property
    def edge(self) -> tuple[str, str]:
        """Target (parent) and source (child) frame."""
        return self.target, self.source

    def sample(self) -> TrackedTransform:
        """The sample in mm. A pose that is not finite or not rigid is lost; its status says so.

        An unknown status counts as INVALID. Raises `FrameError` for names that cannot be frames.
        """
        target, source, ns, (x, y, z), quaternion, status = self
        stamp = Stamp(ns)
        if status != TrackingStatus.OK:
            known = _STATUSES.get(status, TrackingStatus.INVALID)
            return TrackedTransform.lost(target, source, stamp, known)
        translation_mm = (MM_PER_M * x, MM_PER_M * y, MM_PER_M * z)
        if not all(map(math.isfinite, translation_mm + quaternion)):
            return TrackedTransform.lost(target, source, stamp, TrackingStatus.NOT_FINITE)
        try:
            rotation = rotation_of_quaternion(*quaternion)
        except TransformError:
            return TrackedTransform.lost(target, source, stamp, TrackingStatus.NOT_RIGID)
        transform = Transform.unchecked(target, source, rotation, np.array(translation_mm))
        return TrackedTransform.valid(transform, stamp)


_STATUSES = {int(status): status for status in TrackingStatus}


class JointValues(NamedTuple):
    """Joint positions as in their message, stamped on the robot's clock."""

    names: tuple[str, ...]
    positions: tuple[float, ...]
    ns: int

    def sample(self, *, offset_ns: int) -> JointSample:
        """The sample with its stamp moved to the tracker's clock: tracker = robot + offset.

        Raises `InputError` when names and positions differ in number, a name is repeated or a
        position is not finite.
        """
        names, positions, ns = self
        stamp = Stamp(ns + offset_ns)
        if len(set(names)) == len(positions) == len(names) and all(map(math.isfinite, positions)):
            return JointSample.unchecked(names, positions, stamp)
        # The constructor reports a wrong number of positions and a repeated name.
        JointSample(names, positions, stamp)
        name, position = next(
            pair for pair in zip(names, positions, strict=True) if not math.isfinite(pair[1])
        )
        raise InputError(f"joint {name!r} is at {position}; expected a finite position")


class TimeValues(NamedTuple):
    """One time in ns, by the clock of the frame and by the unfiltered clock."""

    ns: int
    unfiltered_ns: int


class RangeValues(NamedTuple):
    """A distance in m at a time in ns."""

    stamp_ns: int
    range_m: float


def tracked_values(message: Any) -> PoseValues:
    """Values of a ``marginguard_msgs/TrackedTransform``."""
    return _pose(message)._replace(status=int(message.status))


def tf_values(message: Any) -> tuple[PoseValues, ...]:
    """Values of a ``tf2_msgs/TFMessage``; its transforms count as OK."""
    return tuple(_pose(stamped) for stamped in message.transforms)


def joint_values(message: Any) -> JointValues:
    """Values of a ``sensor_msgs/JointState``."""
    positions = tuple(float(position) for position in message.position)
    return JointValues(tuple(message.name), positions, _ns(message.header.stamp))


def time_values(message: Any) -> TimeValues:
    """Values of a ``sensor_msgs/TimeReference``."""
    return TimeValues(_ns(message.header.stamp), _ns(message.time_ref))


def bool_value(message: Any) -> bool:
    """Value of a ``std_msgs/Bool``."""
    return bool(message.data)


def range_values(message: Any) -> RangeValues:
    """Stamp and range of a ``sensor_msgs/Range``."""
    return RangeValues(_ns(message.header.stamp), float(message.range))


def frame_name(text: str) -> str:
    """The name of a frame without the leading '/' that tf had before ROS 2."""
    return text.removeprefix("/")


def _pose(message: Any) -> PoseValues:
    move, turn = message.transform.translation, message.transform.rotation
    return PoseValues(
        frame_name(message.header.frame_id),
        frame_name(message.child_frame_id),
        _ns(message.header.stamp),
        (move.x, move.y, move.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def _ns(time: Any) -> int:
    return int(time.sec) * NS_PER_S + int(time.nanosec)
