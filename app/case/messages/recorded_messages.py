"""Tracker and joint samples as the bytes of ROS messages, for a recording of many of them.

The same bytes as those that rosbags writes of message objects. Samples are in mm, messages in m. A
sample that is not OK carries NaN, so that a program that ignores its status cannot navigate by it.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

from app.case.frames.samples import JointSample
from app.case.messages.cdr_template import CdrTemplate
from app.case.messages.values import MM_PER_M
from app.geometry import TrackedTransform, Transform, quaternion_of_rotation

_KEPT = 256
"""Templates of each kind: a recording has a few frames and joints."""

_UNKNOWN = (math.nan,) * 7


def tracked_transform_bytes(sample: TrackedTransform) -> bytes:
    """A serialised ``marginguard_msgs/TrackedTransform``."""
    template = _tracked_template(sample.target, sample.source, int(sample.status))
    return template.serialized([(sample.stamp.ns, _pose_numbers(sample.transform))])


def tf_bytes(samples: Sequence[TrackedTransform]) -> bytes:
    """A serialised ``tf2_msgs/TFMessage`` of samples that are all OK."""
    template = _tf_template(tuple((sample.target, sample.source) for sample in samples))
    return template.serialized(
        [(sample.stamp.ns, _pose_numbers(sample.transform)) for sample in samples]
    )


def joint_state_bytes(sample: JointSample, robot_ns: int) -> bytes:
    """A serialised ``sensor_msgs/JointState``, stamped ``robot_ns`` on the robot's own clock."""
    template = _joint_template(tuple(sample.names))
    return template.serialized([(robot_ns, sample.positions)])


@lru_cache(maxsize=_KEPT)
def _tracked_template(target: str, source: str, status: int) -> CdrTemplate:
    return CdrTemplate().stamp().text(target).text(source).numbers(7).byte(status)


@lru_cache(maxsize=_KEPT)
def _tf_template(edges: tuple[tuple[str, str], ...]) -> CdrTemplate:
    template = CdrTemplate().count(len(edges))
    for target, source in edges:
        template.stamp().text(target).text(source).numbers(7)
    return template


@lru_cache(maxsize=_KEPT)
def _joint_template(names: tuple[str, ...]) -> CdrTemplate:
    template = CdrTemplate().stamp().text("").count(len(names))
    for name in names:
        template.text(name)
    # Positions; velocity and effort are empty.
    return template.count(len(names)).numbers(len(names)).count(0).count(0)


def _pose_numbers(transform: Transform | None) -> Sequence[float]:
    """Translation in m and quaternion xyzw; NaN without a pose."""
    if transform is None:
        return _UNKNOWN
    position_m = (transform.translation_mm / MM_PER_M).tolist()
    return [*position_m, *quaternion_of_rotation(transform.rotation)]
