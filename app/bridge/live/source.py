"""Sources of tracked transforms on the ROS graph, and the source that a ``live.yaml`` names."""

from collections.abc import Mapping
from dataclasses import replace

from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage

from app.bridge import topics
from app.bridge.live.subscription import CountedSubscription
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import IgtlSourceEntry, LiveSourceEntry, TfSourceEntry
from app.case.messages.ros_messages import TF_MESSAGE, TRACKED_TRANSFORM
from app.case.messages.values import PoseValues
from app.geometry import MarginGuardError
from app.igtl import IgtlSource
from app.runtime import Deliver, Source


class TfSource:
    """The transforms of ``/tf``; tf has no word for a lost pose, so all of them are OK."""

    def __init__(self, ros: RosNode, deliver: Deliver) -> None:
        self._deliver: Deliver | None = deliver
        tf = replace(topics.TF, qos=INCOMING)
        self._subscription = CountedSubscription(ros, tf, TF_MESSAGE, self._take)

    def counts(self) -> Mapping[str, int]:
        """Messages, and transforms that cannot be used."""
        return self._subscription.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _take(self, poses: tuple[PoseValues, ...]) -> None:
        samples = []
        for values in poses:
            try:
                samples.append(values.sample())
            except MarginGuardError as error:  # the others of the message are as good as ever
                self._subscription.refuse(error)
        if samples and self._deliver is not None:
            self._deliver(samples)


class TrackedTransformSource:
    """A topic of ``marginguard_msgs/TrackedTransform``: one sample a message, with its status."""

    def __init__(self, ros: RosNode, topic: str, deliver: Deliver) -> None:
        self._deliver: Deliver | None = deliver
        self._subscription = CountedSubscription(
            ros, Topic(topic, TrackedTransformMessage, INCOMING), TRACKED_TRANSFORM, self._take
        )

    def counts(self) -> Mapping[str, int]:
        """Messages, and those that cannot be used."""
        return self._subscription.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _take(self, values: PoseValues) -> None:
        if self._deliver is not None:
            self._deliver([values.sample()])


def source_of(ros: RosNode, entry: LiveSourceEntry, deliver: Deliver) -> Source:
    """The source that a ``live.yaml`` names."""
    if isinstance(entry, IgtlSourceEntry):
        return IgtlSource(entry.host, entry.port, deliver, changed=ros.node.get_logger().info)
    if isinstance(entry, TfSourceEntry):
        return TfSource(ros, deliver)
    return TrackedTransformSource(ros, entry.topic, deliver)
