"""What an OpenIGTLink server tells, published as ROS has it."""

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
"""Every sample, lost ones as well."""

_NAN = math.nan


class IgtlPublisher:
    """Publishes samples on ``/tracked_transforms``, good ones on ``/tf`` too, stamps as they were.

    Lost samples are not on ``/tf``, where nothing could tell them from good ones.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._tracked = ros.publisher(TRACKED_TRANSFORMS)
        self._tf = ros.publisher(topics.TF)
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)

    def publish(self, samples: Sequence[TrackedTransform]) -> None:
        """Send ``samples``, those on ``/tf`` in one message."""
        good = []
        for sample in samples:
            message = tracked_message(sample)
            self._tracked.publish(message)
            if sample.transform is not None:
                good.append(
                    TransformStamped(
                        header=message.header,
                        child_frame_id=message.child_frame_id,
                        transform=message.transform,
                    )
                )
        if good:
            self._tf.publish(TFMessage(transforms=good))

    def report(self, source: IgtlSource, superseded: int) -> None:
        """Tell ``/diagnostics`` how the connection is, and what of it was not used."""
        now = self._ros.node.get_clock().now().to_msg()
        array = DiagnosticArray(status=[_diagnostic(source, superseded)])
        array.header.stamp = now
        self._diagnostics.publish(array)


def tracked_message(sample: TrackedTransform) -> TrackedTransformMessage:
    """``sample`` in metres; NaN where it is lost."""
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
        message=source.words,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
