"""Publish transforms on ``/tf`` and ``/tf_static``, each with the stamp of its sample."""

from collections.abc import Iterable

from tf2_msgs.msg import TFMessage

from app.bridge import messages, topics
from app.bridge.node import RosNode
from app.geometry import Stamp, Transform

_ALWAYS = Stamp(0)


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


class StaticTfBroadcaster:
    """Publishes static transforms on a latched topic.

    The topic keeps only its last message, so every message contains all transforms sent so far.
    """

    def __init__(self, ros: RosNode) -> None:
        self._publisher = ros.publisher(topics.TF_STATIC)
        self._by_child: dict[str, Transform] = {}

    def send(self, transforms: Iterable[Transform]) -> None:
        """Add ``transforms``, replacing those with the same child, and publish all of them."""
        self._by_child.update((transform.source, transform) for transform in transforms)
        self._publisher.publish(tf_message((each, _ALWAYS) for each in self._by_child.values()))


def tf_message(samples: Iterable[tuple[Transform, Stamp]]) -> TFMessage:
    """Convert ``samples`` to one message, with lengths in m."""
    return TFMessage(
        transforms=[messages.transform_message(transform, stamp) for transform, stamp in samples]
    )
