"""Sources of a live session over ROS: tracked transforms, joints, other messages, activations."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from app.bridge import topics
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.topics import INCOMING, Topic
from app.case import (
    ENERGY_DEVICE,
    Activation,
    ActivationTrail,
    IgtlSourceEntry,
    JointSample,
    LiveCase,
    LiveSourceEntry,
    TfSourceEntry,
    message_decoder,
)
from app.case.manifest.images import ActivationEntry
from app.case.messages.message_values import JointValues, PoseValues
from app.case.messages.ros_messages import BOOL, JOINT_STATE, TF_MESSAGE, TRACKED_TRANSFORM
from app.geometry import MarginGuardError, TrackedTransform
from app.igtl import Header, IgtlSource, Unread, read_string
from app.robot import JointError
from app.runtime import Deliver, Source

MAX_BYTES = 1 << 20
"""Room for a thousand transforms with long names."""

WORDS = {"on": True, "1": True, "true": True, "off": False, "0": False, "false": False}
"""Texts of a STRING, in capitals or not."""


class SampleFilter(Protocol):
    """Decides which received samples are used, as `app.bridge.live.sender_watch` does."""

    def accepts_pose(self, pose: PoseValues, origin: Origin) -> bool:
        """Process a sample of the source; False if it must not be used."""

    def take_tf(self, poses: Sequence[PoseValues], origin: Origin, *, latched: bool) -> None:
        """Process a message of ``/tf``."""


class CountedSubscription:
    """Calls ``receive(values, origin)`` with each message, read as values of `app.case.messages`.

    What it returns, unless that is None, is passed to ``deliver``. Both are called in the node's
    thread. Messages that are oversized or unreadable are counted, and so are those for which one of
    the calls raises a `MarginGuardError`.
    """

    def __init__(
        self,
        ros: RosNode,
        topic: Topic,
        message_type: str,
        receive: Callable[[Any, Origin], Any],
        deliver: Callable[[Any], None] | None = None,
    ) -> None:
        self._name = topic.name
        self._read = message_decoder(message_type)
        self._receive = receive
        self._deliver = deliver
        self._counts: Counter[str] = Counter()
        ros.subscribe_with_origin(topic, self._on_message)

    def counts(self) -> Mapping[str, int]:
        """Number of received messages, and of refused ones by type of error."""
        return dict(self._counts)

    def refuse(self, error: MarginGuardError) -> None:
        """Count an invalid part of a message."""
        self._counts[f"{self._name}: refused ({type(error).__name__})"] += 1

    def close(self) -> None:
        """Deliver nothing more."""
        self._deliver = None

    def _on_message(self, data: bytes, origin: Origin) -> None:
        self._counts[f"{self._name}: messages"] += 1
        if len(data) > MAX_BYTES:
            self._counts[f"{self._name}: refused (longer than {MAX_BYTES} bytes)"] += 1
            return
        try:
            received, deliver = self._receive(self._read(data), origin), self._deliver
            if received is not None and deliver is not None:
                deliver(received)
        except MarginGuardError as error:
            self.refuse(error)


class TfSource(CountedSubscription):
    """Source of the transforms on ``/tf``, all with status OK because tf has no status."""

    def __init__(self, ros: RosNode, deliver: Deliver, senders: SampleFilter) -> None:
        self._senders = senders
        tf = replace(topics.TF, qos=INCOMING)
        super().__init__(ros, tf, TF_MESSAGE, self._samples, deliver)

    def _samples(
        self, poses: Sequence[PoseValues], origin: Origin
    ) -> Sequence[TrackedTransform] | None:
        samples = []
        self._senders.take_tf(poses, origin, latched=False)
        for values in poses:
            if not self._senders.accepts_pose(values, origin):
                continue
            try:
                samples.append(values.sample())
            except MarginGuardError as error:  # keep the valid samples of the message
                self.refuse(error)
        return samples or None


class TrackedTransformSource(CountedSubscription):
    """Source on a topic of ``marginguard_msgs/TrackedTransform``: one sample per message."""

    def __init__(self, ros: RosNode, topic: str, deliver: Deliver, senders: SampleFilter) -> None:
        self._senders = senders
        tracked = Topic(topic, TrackedTransformMessage, INCOMING)
        super().__init__(ros, tracked, TRACKED_TRANSFORM, self._samples, deliver)

    def _samples(self, values: PoseValues, origin: Origin) -> Sequence[TrackedTransform] | None:
        return [values.sample()] if self._senders.accepts_pose(values, origin) else None


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


def listen_to_joints(
    ros: RosNode,
    topic: str,
    offset_ns: int,
    deliver: Callable[[JointSample], None],
    accepts: Callable[[JointValues, Origin], bool],
    is_complete: Callable[[Sequence[str]], bool],
) -> CountedSubscription:
    """Deliver each joint state of ``topic`` with ``offset_ns`` added to the robot's stamps.

    Those that ``accepts`` refuses are not delivered. Neither are those that are not
    ``is_complete`` by the names of their joints: they are of another device, or a part of the arm.
    They are counted as `JointError`.
    """

    def sample(values: JointValues, origin: Origin) -> JointSample | None:
        if not accepts(values, origin):
            return None
        if not is_complete(values.names):
            raise JointError(f"{topic}: a message without all joints that move the tool")
        return values.sample(offset_ns=offset_ns)

    return CountedSubscription(
        ros, Topic(topic, JointState, INCOMING), JOINT_STATE, sample, deliver
    )


class TopicActivation:
    """Follows ``std_msgs/Bool`` on a topic; two publishers make the state unknown."""

    def __init__(
        self, ros: RosNode, topic: str, trail: ActivationTrail, clock_ns: Callable[[], int]
    ) -> None:
        self._ros, self._topic, self._trail, self._clock_ns = ros, topic, trail, clock_ns
        self._refused = 0
        self._subscription = CountedSubscription(
            ros, Topic(topic, Bool, INCOMING), BOOL, self._on_message
        )

    def counts(self) -> Mapping[str, int]:
        """Counts of messages, for diagnostics."""
        refused = {f"{self._topic}: of two publishers": self._refused} if self._refused else {}
        return {**self._subscription.counts(), **refused}

    def state(self) -> Activation:
        """The present state."""
        return self._trail.at(self._clock_ns())

    def _on_message(self, on: bool, origin: Origin) -> None:
        if self._ros.node.count_publishers(self._topic) > 1:
            self._refused += 1
            self._trail.forget()
            return
        self._trail.hear(on, self._clock_ns())


class IgtlActivation:
    """Follows the STRING messages of ``device``: on, off, 1, 0, true or false.

    Another text makes the state unknown. Give `receive` to the source of the poses.
    """

    def __init__(self, device: str, trail: ActivationTrail, clock_ns: Callable[[], int]) -> None:
        self._device, self._trail, self._clock_ns = device, trail, clock_ns
        self._counts: Counter[str] = Counter()

    def counts(self) -> Mapping[str, int]:
        """Counts of messages, for diagnostics."""
        return {f"{ENERGY_DEVICE.name}: {name}": count for name, count in self._counts.items()}

    def state(self) -> Activation:
        """The present state."""
        return self._trail.at(self._clock_ns())

    def receive(self, header: Header, body: bytes) -> None:
        """Take a STRING message as it came."""
        said = said_by(self._device, header, body)
        if said is None:
            return
        self._counts["messages"] += 1
        if isinstance(said, bool):
            self._trail.hear(said, self._clock_ns())
        else:
            self._counts["refused"] += 1
            self._trail.forget()


def said_by(device: str, header: Header, body: bytes) -> bool | str | None:
    """Whether a STRING of ``device`` says that it is on; a text why it cannot be understood.

    None for a message of another device.
    """
    if header.device != device.encode():
        return None
    try:
        _, text = read_string(header, body)
    except MarginGuardError as error:
        return str(error)
    said = WORDS.get(text.strip().lower())
    return f"{text[:40]!r}; expected one of {', '.join(WORDS)}" if said is None else said


ActivationInput = TopicActivation | IgtlActivation


def activation_input(ros: RosNode, config: LiveCase) -> ActivationInput | None:
    """The input of the activation by ``config``; None for a session without it."""
    entry: ActivationEntry | None = config.case.manifest.activation
    if entry is None:
        return None
    trail = ActivationTrail(entry.stale_after_ns)
    if entry.topic is not None:
        return TopicActivation(ros, entry.topic, trail, time.monotonic_ns)
    return IgtlActivation(entry.device or "", trail, time.monotonic_ns)
