"""Subscription that queues all messages until another thread takes them."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile

from app.bridge.convert.topics import MAX_BYTES, create_endpoint, read_message
from app.bridge.convert.types import message_type
from app.bridge.node import RosNode
from app.bridge.qos import Topic


class TopicQueue:
    """Serialised messages since the last `take`, ``qos.depth`` at most.

    A full queue drops its oldest message and counts it in `lost`. Messages that DDS drops before
    the node's thread receives them are not counted. Messages over 256 MB are ignored and counted
    in `too_long`. ``received()`` is called in the node's thread after every queued message.
    """

    def __init__(
        self,
        ros: RosNode,
        kind: str | type,
        name: str,
        qos: QoSProfile,
        received: Callable[[], None] = lambda: None,
    ) -> None:
        self.topic = Topic(name, message_type(kind), qos)
        self.lost = 0
        self.too_long = 0
        self._ros = ros
        self._received = received
        self._lock = threading.Lock()
        self._raws: deque[bytes] = deque()
        self._subscription = create_endpoint(
            lambda: ros.subscribe(self.topic, self._on_message, raw=True), name
        )

    def take(self) -> list[bytes]:
        """Remove and return the queued messages, oldest first; `read` deserialises them."""
        with self._lock:
            raws = list(self._raws)
            self._raws.clear()
        return raws

    def read(self, raw: bytes) -> Any:
        """Deserialise a message (lengths in m); raises `ConversionError`."""
        return read_message(raw, self.topic)

    def close(self) -> None:
        """Destroy the subscription. Closing the node does this as well."""
        self._ros.call(lambda: self._ros.destroy_subscription(self._subscription))

    def _on_message(self, raw: bytes) -> None:
        if len(raw) > MAX_BYTES:
            self.too_long += 1
            return
        with self._lock:
            self._raws.append(raw)
            if len(self._raws) > self.topic.qos.depth:
                self._raws.popleft()
                self.lost += 1
        self._received()
