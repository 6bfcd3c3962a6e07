"""A subscription to bytes from strangers: what is too long or unreadable is counted."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.case import values_reader
from app.geometry import MarginGuardError

MOST_BYTES = 1 << 20
"""A thousand transforms with long names; more in one message is no tracker and no robot."""


class CountedSubscription:
    """Calls ``take(values)`` with what `app.case.messages.values` reads of each message.

    ``take`` is called in the node's thread; a `MarginGuardError` of its own is counted like a
    message that cannot be read.
    """

    def __init__(
        self, ros: RosNode, topic: Topic, message_type: str, take: Callable[[Any], None]
    ) -> None:
        self._name = topic.name
        self._read = values_reader(message_type)
        self._take = take
        self._counts: Counter[str] = Counter()
        ros.subscribe(topic, self._received, raw=True)

    def counts(self) -> Mapping[str, int]:
        """How many messages came, and how many were refused for which kind of error."""
        return dict(self._counts)

    def refuse(self, error: MarginGuardError) -> None:
        """Count a part of a message that cannot be used."""
        self._counts[f"{self._name}: refused ({type(error).__name__})"] += 1

    def _received(self, data: bytes) -> None:
        self._counts[f"{self._name}: messages"] += 1
        if len(data) > MOST_BYTES:
            self._counts[f"{self._name}: refused (longer than {MOST_BYTES} bytes)"] += 1
            return
        try:
            self._take(self._read(data))
        except MarginGuardError as error:
            self.refuse(error)
