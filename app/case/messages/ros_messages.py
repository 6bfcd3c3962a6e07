"""Tracker and joint samples as ROS messages, built by rosbags without ROS.

Samples are in mm, messages in m. A sample that is not OK carries NaN, so that a program that
ignores its status cannot navigate by it.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from app.case.frames.samples import JointSample
from app.case.messages.values import MM_PER_M
from app.geometry import NS_PER_S, InputError, Stamp, TrackedTransform, Transform

TRACKED_TRANSFORMS_TOPIC = "/tracked_transforms"
TF_TOPIC = "/tf"
JOINT_STATES_TOPIC = "/joint_states"
UNFILTERED_TIME_TOPIC = "/tracked_transforms/unfiltered_time"
"""Second clock of an IGSIO recording: header.stamp is the frame's stamp, time_ref the other."""

TRACKED_TRANSFORM = "marginguard_msgs/msg/TrackedTransform"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
JOINT_STATE = "sensor_msgs/msg/JointState"
TIME_REFERENCE = "sensor_msgs/msg/TimeReference"

TRACKED_TRANSFORM_DEFINITION = """\
uint8 OK=0
uint8 INVALID=1
uint8 MISSING=2
uint8 OUT_OF_VIEW=3
uint8 OUT_OF_VOLUME=4
uint8 REQUEST_TIMEOUT=5
uint8 NOT_FINITE=6
uint8 NOT_RIGID=7
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
uint8 status
"""

_SEC_LIMIT = 2**31


@cache
def ros_types() -> Typestore:
    """The message types of ROS 2 Jazzy and of this project; shared and never modified."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TRACKED_TRANSFORM_DEFINITION, TRACKED_TRANSFORM))
    return store


def tracked_transform_message(sample: TrackedTransform) -> Any:
    """Build a ``marginguard_msgs/TrackedTransform``."""
    return ros_types().types[TRACKED_TRANSFORM](
        header=_header(sample.stamp.ns, sample.target),
        child_frame_id=sample.source,
        transform=_transform(sample.transform),
        status=int(sample.status),
    )


def tf_message(samples: Sequence[TrackedTransform]) -> Any:
    """Build a ``tf2_msgs/TFMessage`` of samples that are all OK."""
    stamped = ros_types().types["geometry_msgs/msg/TransformStamped"]
    return ros_types().types[TF_MESSAGE](
        transforms=[
            stamped(
                header=_header(sample.stamp.ns, sample.target),
                child_frame_id=sample.source,
                transform=_transform(sample.transform),
            )
            for sample in samples
        ]
    )


def joint_state_message(sample: JointSample, robot_ns: int) -> Any:
    """Build a ``sensor_msgs/JointState``, stamped ``robot_ns`` on the robot's own clock."""
    return ros_types().types[JOINT_STATE](
        header=_header(robot_ns, ""),
        name=list(sample.names),
        position=np.array(sample.positions),
        velocity=np.empty(0),
        effort=np.empty(0),
    )


def time_reference_message(stamp: Stamp, unfiltered: Stamp) -> Any:
    """Build a ``sensor_msgs/TimeReference``: the time of the unsmoothed clock at ``stamp``."""
    return ros_types().types[TIME_REFERENCE](
        header=_header(stamp.ns, ""), time_ref=_time(unfiltered.ns), source="unfiltered"
    )


def _header(ns: int, frame: str) -> Any:
    return ros_types().types["std_msgs/msg/Header"](stamp=_time(ns), frame_id=frame)


def _time(ns: int) -> Any:
    sec, nanosec = divmod(ns, NS_PER_S)
    if not -_SEC_LIMIT <= sec < _SEC_LIMIT:
        raise InputError(f"stamp is {ns} ns; expected a ROS time, within 2^31 s of 0")
    return ros_types().types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)


def _transform(transform: Transform | None) -> Any:
    types = ros_types().types
    x, y, z = (math.nan,) * 3
    qx, qy, qz, qw = (math.nan,) * 4
    if transform is not None:
        x, y, z = (transform.translation_mm / MM_PER_M).tolist()
        qx, qy, qz, qw = transform.quaternion_xyzw.tolist()
    return types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
        rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
