"""Transforms of ours to ``/tf`` and ``/tf_static``, each with the stamp of its own sample."""

from collections.abc import Iterable

from tf2_msgs.msg import TFMessage

from app.bridge import messages, topics
from app.bridge.node import RosNode
from app.geometry import Stamp, Transform

_ALWAYS = Stamp(0)


class TfBroadcaster:
    """``broadcaster.send([(reference_from_needle, stamp), ...])``: parent is the target.

    A stamp is when the transform was true, never when it was sent. One message a call.
    """

    def __init__(self, ros: RosNode) -> None:
        self._publisher = ros.publisher(topics.TF)

    def send(self, samples: Iterable[tuple[Transform, Stamp]]) -> None:
        """Publish ``samples`` in one message; nothing when there are none."""
        message = tf_message(samples)
        if message.transforms:
            self._publisher.publish(message)


class StaticTfBroadcaster:
    """Transforms that always hold, latched: whoever joins later has all of them at once.

    The topic keeps its last message alone, so each one repeats what was said before.
    """

    def __init__(self, ros: RosNode) -> None:
        self._publisher = ros.publisher(topics.TF_STATIC)
        self._of_child: dict[str, Transform] = {}

    def send(self, transforms: Iterable[Transform]) -> None:
        """Add ``transforms`` to what is latched; one of a known child takes its place."""
        self._of_child.update((transform.source, transform) for transform in transforms)
        self._publisher.publish(tf_message((each, _ALWAYS) for each in self._of_child.values()))


def tf_message(samples: Iterable[tuple[Transform, Stamp]]) -> TFMessage:
    """One message with all ``samples``, mm made metres."""
    return TFMessage(
        transforms=[messages.transform_message(transform, stamp) for transform, stamp in samples]
    )
