"""Publish transforms on ``/tf``, each with the stamp of its sample."""

from collections.abc import Iterable

from tf2_msgs.msg import TFMessage

from app.bridge import messages, topics
from app.bridge.node import RosNode
from app.geometry import Stamp, Transform


class TfBroadcaster:
    """``broadcaster.send([(reference_from_needle, stamp), ...])``; the parent is the target.

    A stamp is the time of measurement, not of sending. One message per call.
    """

    def __init__(self, ros: RosNode) -> None:
        self._publisher = ros.publisher(topics.TF)

    def send(self, samples: Iterable[tuple[Transform, Stamp]]) -> None:
        """Publish ``samples`` in one message; publishes nothing if there are none."""
        message = tf_message(samples)
        if message.transforms:
            self._publisher.publish(message)


def tf_message(samples: Iterable[tuple[Transform, Stamp]]) -> TFMessage:
    """Convert ``samples`` to one message, with lengths in m."""
    return TFMessage(
        transforms=[messages.transform_message(transform, stamp) for transform, stamp in samples]
    )
