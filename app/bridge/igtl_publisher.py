"""Publish the samples of an OpenIGTLink server on ROS topics."""

import math
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.messages import header_message, transform_message
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic
from app.geometry import TrackedTransform
from app.igtl.source import IgtlSource

TRACKED_TRANSFORMS = Topic("/tracked_transforms", TrackedTransformMessage, STREAM)
"""Every sample, including lost ones."""

_NAN = math.nan


class IgtlPublisher:
    """Publishes samples on ``/tracked_transforms`` and valid ones also on ``/tf``.

    Stamps are not changed. Lost samples are not on ``/tf``, which has no field for a status.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._tracked = ros.publisher(TRACKED_TRANSFORMS)
        self._tf = ros.publisher(topics.TF)
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)

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

    def report(self, source: IgtlSource, superseded: int) -> None:
        """Publish the state of the connection and its counters on ``/diagnostics``."""
        now = self._ros.node.get_clock().now().to_msg()
        array = DiagnosticArray(status=[_diagnostic(source, superseded)])
        array.header.stamp = now
        self._diagnostics.publish(array)


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


def _diagnostic(source: IgtlSource, superseded: int) -> DiagnosticStatus:
    counts = source.counts()
    refused = any(": refused" in key for key in counts)
    level = DiagnosticStatus.WARN if refused else DiagnosticStatus.OK
    values = {
        **{key: str(count) for key, count in sorted(counts.items())},
        "samples that a newer one replaced": str(superseded),
        "last refusal": source.last_refusal,
    }
    return DiagnosticStatus(
        level=level if source.connected else DiagnosticStatus.ERROR,
        name="marginguard: OpenIGTLink",
        message=source.status,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
