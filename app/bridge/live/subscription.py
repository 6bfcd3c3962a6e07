"""Subscription to serialised messages that counts oversized and unreadable ones."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.case import values_reader
from app.geometry import MarginGuardError

MAX_BYTES = 1 << 20
"""Room for a thousand transforms with long names."""


class CountedSubscription:
    """Calls ``receive(values, origin)`` with each message, read by `app.case.messages.values`.

    ``receive`` is called in the node's thread. A `MarginGuardError` that it raises is counted like
    an unreadable message.
    """

    def __init__(
        self, ros: RosNode, topic: Topic, message_type: str, receive: Callable[[Any, Origin], None]
    ) -> None:
        self._name = topic.name
        self._read = values_reader(message_type)
        self._receive = receive
        self._counts: Counter[str] = Counter()
        ros.subscribe_with_origin(topic, self._on_message)

    def counts(self) -> Mapping[str, int]:
        """Number of received messages, and of refused ones by type of error."""
        return dict(self._counts)

    def refuse(self, error: MarginGuardError) -> None:
        """Count an invalid part of a message."""
        self._counts[f"{self._name}: refused ({type(error).__name__})"] += 1

    def _on_message(self, data: bytes, origin: Origin) -> None:
        self._counts[f"{self._name}: messages"] += 1
        if len(data) > MAX_BYTES:
            self._counts[f"{self._name}: refused (longer than {MAX_BYTES} bytes)"] += 1
            return
        try:
            self._receive(self._read(data), origin)
        except MarginGuardError as error:
            self.refuse(error)
