"""Sources of tracked transforms on the ROS graph, and the source that a ``live.yaml`` names."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage

from app.bridge import topics
from app.bridge.live.subscription import CountedSubscription
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import IgtlSourceEntry, LiveSourceEntry, TfSourceEntry
from app.case.messages.ros_messages import TF_MESSAGE, TRACKED_TRANSFORM
from app.case.messages.values import PoseValues
from app.geometry import MarginGuardError
from app.igtl import IgtlSource, Unread
from app.runtime import Deliver, Source


class SampleFilter(Protocol):
    """Decides which received samples are used, as `app.bridge.live.sender_watch` does."""

    def accepts_pose(self, pose: PoseValues, origin: Origin) -> bool:
        """Process a sample of the source; False if it must not be used."""

    def take_tf(self, poses: Sequence[PoseValues], origin: Origin, *, latched: bool) -> None:
        """Process a message of ``/tf``."""


class TfSource:
    """Source of the transforms on ``/tf``, all with status OK because tf has no status."""

    def __init__(self, ros: RosNode, deliver: Deliver, senders: SampleFilter) -> None:
        self._deliver: Deliver | None = deliver
        self._senders = senders
        tf = replace(topics.TF, qos=INCOMING)
        self._subscription = CountedSubscription(ros, tf, TF_MESSAGE, self._on_message)

    def counts(self) -> Mapping[str, int]:
        """Number of messages, and of refused transforms by type of error."""
        return self._subscription.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _on_message(self, poses: tuple[PoseValues, ...], origin: Origin) -> None:
        samples = []
        self._senders.take_tf(poses, origin, latched=False)
        for values in poses:
            if not self._senders.accepts_pose(values, origin):
                continue
            try:
                samples.append(values.sample())
            except MarginGuardError as error:  # keep the valid samples of the message
                self._subscription.refuse(error)
        if samples and self._deliver is not None:
            self._deliver(samples)


class TrackedTransformSource:
    """Source on a topic of ``marginguard_msgs/TrackedTransform``: one sample per message."""

    def __init__(self, ros: RosNode, topic: str, deliver: Deliver, senders: SampleFilter) -> None:
        self._deliver: Deliver | None = deliver
        self._senders = senders
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

    def _on_message(self, values: PoseValues, origin: Origin) -> None:
        if self._senders.accepts_pose(values, origin) and self._deliver is not None:
            self._deliver([values.sample()])


def source_of(
    ros: RosNode,
    entry: LiveSourceEntry,
    deliver: Deliver,
    senders: SampleFilter,
    images: Unread | None = None,
    strings: Unread | None = None,
) -> Source:
    """Create the source that ``live.yaml`` configures.

    An OpenIGTLink source is one TCP connection, which has one sender: nothing is filtered. It also
    passes IMAGE messages to ``images`` and STRING messages to ``strings``.
    """
    if isinstance(entry, IgtlSourceEntry):
        return IgtlSource(
            entry.host,
            entry.port,
            deliver,
            changed=ros.node.get_logger().info,
            images=images,
            strings=strings,
        )
    if isinstance(entry, TfSourceEntry):
        return TfSource(ros, deliver, senders)
    return TrackedTransformSource(ros, entry.topic, deliver, senders)
