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
    """Source of the transforms on ``/tf``, all with status OK because tf has no status."""

    def __init__(self, ros: RosNode, deliver: Deliver) -> None:
        self._deliver: Deliver | None = deliver
        tf = replace(topics.TF, qos=INCOMING)
        self._subscription = CountedSubscription(ros, tf, TF_MESSAGE, self._on_message)

    def counts(self) -> Mapping[str, int]:
        """Number of messages, and of refused transforms by type of error."""
        return self._subscription.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _on_message(self, poses: tuple[PoseValues, ...]) -> None:
        samples = []
        for values in poses:
            try:
                samples.append(values.sample())
            except MarginGuardError as error:  # keep the valid samples of the message
                self._subscription.refuse(error)
        if samples and self._deliver is not None:
            self._deliver(samples)


class TrackedTransformSource:
    """Source on a topic of ``marginguard_msgs/TrackedTransform``: one sample per message."""

    def __init__(self, ros: RosNode, topic: str, deliver: Deliver) -> None:
        self._deliver: Deliver | None = deliver
        self._subscription = CountedSubscription(
            ros,
            Topic(topic, TrackedTransformMessage, INCOMING),
            TRACKED_TRANSFORM,
            self._on_message,
        )

    def counts(self) -> Mapping[str, int]:
        """Number of messages, and of refused ones by type of error."""
        return self._subscription.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _on_message(self, values: PoseValues) -> None:
        if self._deliver is not None:
            self._deliver([values.sample()])


def source_of(ros: RosNode, entry: LiveSourceEntry, deliver: Deliver) -> Source:
    """Create the source that ``live.yaml`` configures."""
    if isinstance(entry, IgtlSourceEntry):
        return IgtlSource(entry.host, entry.port, deliver, changed=ros.node.get_logger().info)
    if isinstance(entry, TfSourceEntry):
        return TfSource(ros, deliver)
    return TrackedTransformSource(ros, entry.topic, deliver)
