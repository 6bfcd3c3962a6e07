"""Conversion of core values to ROS messages: the only place that converts mm to m.

======================================== ============ ==============
field                                    core         message
======================================== ============ ==============
Transform.translation                    mm           m
Transform.rotation                       (3, 3)       quaternion, w >= 0
JointState.position                      rad or m     rad or m
header.stamp, Clock.clock                integer ns   s and ns, exact
Marker.points                            mm           m
Marker.color, ColorRGBA                  0 to 1       0 to 1
======================================== ============ ==============

`constraint_message` converts the constraint, with `metres`. Topics whose name ends in ``_mm``
are in mm.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped, Vector3
from numpy.typing import ArrayLike
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header

from app.bridge.ros_errors import BridgeError
from app.case import CaseManifest
from app.case.frame_streams import JointSample
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform, quaternion_of_rotation

MM_PER_M = 1000.0
TRANSFORM_NUMBERS = 7
_LAST_SECOND = 2**31 - 1


def metres(values_mm: ArrayLike) -> FloatArray:
    """Convert lengths, points or vectors of any shape from mm to m."""
    return np.asarray(values_mm, dtype=np.float64) / MM_PER_M


def time_message(stamp: Stamp) -> Time:
    """Split a stamp into seconds and nanoseconds; ``nanosec`` is never negative.

    Raises `BridgeError` for a stamp beyond the 32-bit seconds of a ROS time.
    """
    message = Time()
    set_time(message, stamp)
    return message


def set_time(message: Time, stamp: Stamp) -> None:
    """Fill in ``message`` as `time_message`; quicker for a part of a message that exists."""
    message.sec, message.nanosec = time_parts(stamp)


def time_parts(stamp: Stamp) -> tuple[int, int]:
    """Seconds and nanoseconds of `time_message`; raises `BridgeError` as it does."""
    seconds, nanoseconds = divmod(stamp.ns, NS_PER_S)
    if abs(seconds) > _LAST_SECOND:
        raise BridgeError(
            f"stamp {stamp.ns} ns does not fit a ROS time; expected at most {_LAST_SECOND} s"
        )
    return seconds, nanoseconds


def ns_of(time: Time) -> int:
    """The time of a message in ns."""
    return int(time.sec * NS_PER_S + time.nanosec)


def header_message(frame: str, stamp: Stamp) -> Header:
    """Header in ``frame`` with the acquisition time ``stamp``."""
    message = Header(frame_id=frame)
    set_time(message.stamp, stamp)
    return message


def vector_message(values: ArrayLike) -> Vector3:
    """Vector of three numbers, not scaled: the caller chooses the unit."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return Vector3(x=x, y=y, z=z)


def point_message(point_mm: ArrayLike) -> Point:
    """Convert a point (3,) in mm to a message in m."""
    x, y, z = metres(point_mm).tolist()
    return Point(x=x, y=y, z=z)


def quaternion_message(transform: Transform) -> Quaternion:
    """Rotation of ``transform`` as a quaternion with w >= 0."""
    x, y, z, w = quaternion_of_rotation(transform.rotation)
    return Quaternion(x=x, y=y, z=z, w=w)


def transform_message(transform: Transform, stamp: Stamp) -> TransformStamped:
    """Convert ``target_from_source`` to tf: the target is the parent, the source the child."""
    numbers = transform_numbers(transform)
    return transform_of(transform.target, transform.source, time_parts(stamp), numbers)


def transform_of(
    parent: str, child: str, time: tuple[int, int], numbers: Sequence[float]
) -> TransformStamped:
    """Message of the parts of a transform: `time_parts` and `transform_numbers`."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = time
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = numbers
    return message


def pose_of(message: Pose, frame: str, source: str) -> Transform:
    """``frame_from_source`` of a pose. Raises `MarginGuardError` for numbers that are no pose."""
    return placed(message.position, message.orientation, frame, source)


def placed(place: Point | Vector3, turn: Quaternion, frame: str, source: str) -> Transform:
    """``frame_from_source`` at ``place`` in m. Raises as `pose_of`."""
    return Transform.from_quaternion(
        (turn.x, turn.y, turn.z, turn.w),
        [MM_PER_M * value for value in (place.x, place.y, place.z)],
        target=frame,
        source=source,
    )


def transform_numbers(transform: Transform) -> tuple[float, ...]:
    """The `TRANSFORM_NUMBERS` numbers of the message: x, y, z in m and a quaternion xyzw."""
    x, y, z = transform.translation_mm.tolist()
    turn = quaternion_of_rotation(transform.rotation)
    return (x / MM_PER_M, y / MM_PER_M, z / MM_PER_M, *turn)


def joint_state_message(sample: JointSample) -> JointState:
    """Joint positions (rad or m) with the stamp of their sample, without velocity and effort."""
    message = JointState(name=list(sample.names), position=list(sample.positions))
    set_time(message.header.stamp, sample.stamp)
    return message


def clock_message(now: Stamp) -> Clock:
    """Clock message with the player's time."""
    return Clock(clock=time_message(now))


def color_message(rgb: Iterable[float], alpha: float = 1.0) -> ColorRGBA:
    """Color from red, green, blue and opacity, each from 0 to 1."""
    r, g, b = (float(value) for value in rgb)
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


def diagnostic_status(
    part: str, level: bytes, message: str, values: Mapping[str, object], hardware: str = ""
) -> DiagnosticStatus:
    """Status ``marginguard: part``; the values are written as text."""
    return DiagnosticStatus(
        level=level,
        name=f"marginguard: {part}",
        message=message,
        hardware_id=hardware,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def playback_text(manifest: CaseManifest) -> str:
    """Name and provenance of a recording, for its announcement on `app.bridge.topics.PLAYBACK`."""
    provenance = manifest.provenance
    return f"{manifest.name} ({provenance.kind}: {provenance.source})"
