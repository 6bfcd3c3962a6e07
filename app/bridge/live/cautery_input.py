"""The state of the cautery in a live session: from a topic, or from an OpenIGTLink STRING."""

import time
from collections import Counter
from collections.abc import Callable, Mapping

from std_msgs.msg import Bool

from app.bridge.live.sources import CountedSubscription
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import CauteryState, CauteryTrail, LiveCase
from app.case.manifest.images import CauteryEntry
from app.case.messages.ros_messages import BOOL
from app.geometry import MarginGuardError
from app.igtl import Header, read_string

WORDS = {"on": True, "1": True, "true": True, "off": False, "0": False, "false": False}
"""Texts of a STRING, in capitals or not."""


class TopicCautery:
    """Follows ``std_msgs/Bool`` on a topic; two publishers make the state unknown."""

    def __init__(
        self, ros: RosNode, topic: str, trail: CauteryTrail, clock_ns: Callable[[], int]
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

    def state(self) -> CauteryState:
        """The present state."""
        return self._trail.at(self._clock_ns())

    def _on_message(self, on: bool, origin: Origin) -> None:
        if self._ros.node.count_publishers(self._topic) > 1:
            self._refused += 1
            self._trail.forget()
            return
        self._trail.hear(on, self._clock_ns())


class IgtlCautery:
    """Follows the STRING messages of ``device``: on, off, 1, 0, true or false.

    Another text makes the state unknown. Give `receive` to the source of the poses.
    """

    def __init__(self, device: str, trail: CauteryTrail, clock_ns: Callable[[], int]) -> None:
        self._device, self._trail, self._clock_ns = device, trail, clock_ns
        self._counts: Counter[str] = Counter()

    def counts(self) -> Mapping[str, int]:
        """Counts of messages, for diagnostics."""
        return {f"cautery: {name}": count for name, count in self._counts.items()}

    def state(self) -> CauteryState:
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
    """Whether the cautery is on by a STRING of ``device``; a text why it cannot be understood.

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


CauteryInput = TopicCautery | IgtlCautery


def cautery_input(
    ros: RosNode, config: LiveCase, clock_ns: Callable[[], int] = time.monotonic_ns
) -> CauteryInput | None:
    """The input of the cautery's state by ``config``; None for a session without it."""
    entry: CauteryEntry | None = config.case.manifest.cautery
    if entry is None:
        return None
    trail = CauteryTrail(entry.stale_after_ns)
    if entry.topic is not None:
        return TopicCautery(ros, entry.topic, trail, clock_ns)
    return IgtlCautery(entry.device or "", trail, clock_ns)
