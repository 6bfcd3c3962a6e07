"""Tracker and joint samples as message objects of rosbags, which its serialiser writes."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from app.case.frame_streams import JointSample
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TRACKED_TRANSFORM,
    ros_types,
    stamp_parts,
)
from app.geometry import TrackedTransform, Transform


def tracked_transform_message(sample: TrackedTransform) -> Any:
    """A ``marginguard_msgs/TrackedTransform``."""
    return ros_types().types[TRACKED_TRANSFORM](
        header=_header(sample.stamp.ns, sample.target),
        child_frame_id=sample.source,
        transform=_transform(sample.transform),
        status=int(sample.status),
    )


def tf_message(samples: Sequence[TrackedTransform]) -> Any:
    """A ``tf2_msgs/TFMessage``."""
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
    """A ``sensor_msgs/JointState``, stamped ``robot_ns``."""
    return ros_types().types[JOINT_STATE](
        header=_header(robot_ns, ""),
        name=list(sample.names),
        position=np.array(sample.positions),
        velocity=np.empty(0),
        effort=np.empty(0),
    )


def _header(ns: int, frame: str) -> Any:
    sec, nanosec = stamp_parts(ns)
    stamp = ros_types().types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return ros_types().types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _transform(transform: Transform | None) -> Any:
    types = ros_types().types
    x, y, z = (math.nan,) * 3
    qx, qy, qz, qw = (math.nan,) * 4
    if transform is not None:
        x, y, z = (transform.translation_mm / 1000.0).tolist()
        qx, qy, qz, qw = transform.quaternion_xyzw.tolist()
    return types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
        rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
