"""Publish samples of a tracker on ROS topics, as the driver of a tracker does."""

import math
from collections.abc import Sequence

from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.messages import header_message, transform_message
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic
from app.geometry import TrackedTransform

TRACKED_TRANSFORMS = Topic("/tracked_transforms", TrackedTransformMessage, STREAM)
"""Every sample, including lost ones."""

_NAN = math.nan


class TrackerPublisher:
    """Publishes samples on ``topic`` and valid ones also on ``/tf``.

    Stamps are not changed. Lost samples are not on ``/tf``, which has no field for a status.
    """

    def __init__(self, ros: RosNode, topic: Topic = TRACKED_TRANSFORMS) -> None:
        self._tracked = ros.publisher(topic)
        self._tf = ros.publisher(topics.TF)

    def publish(self, samples: Sequence[TrackedTransform]) -> None:
        """Publish ``samples``; the valid ones go into one ``/tf`` message."""
        valid = []
        for sample in samples:
            message = tracked_message(sample)
            self._tracked.publish(message)
            if sample.transform is not None:
                valid.append(
                    TransformStamped(
                        header=message.header,
                        child_frame_id=message.child_frame_id,
                        transform=message.transform,
                    )
                )
        if valid:
            self._tf.publish(TFMessage(transforms=valid))


def tracked_message(sample: TrackedTransform) -> TrackedTransformMessage:
    """Convert ``sample`` to a message in metres; all numbers are NaN if it is lost."""
    message = TrackedTransformMessage(
        header=header_message(sample.target, sample.stamp),
        child_frame_id=sample.source,
        status=int(sample.status),
    )
    if sample.transform is None:
        message.transform.translation = Vector3(x=_NAN, y=_NAN, z=_NAN)
        message.transform.rotation = Quaternion(x=_NAN, y=_NAN, z=_NAN, w=_NAN)
    else:
        message.transform = transform_message(sample.transform, sample.stamp).transform
    return message
