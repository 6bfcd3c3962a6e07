"""Publishers and subscribers for any topic, given by name and type, with plain values."""

import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from app.bridge.convert.errors import ConversionError
from app.bridge.convert.plain import Plain, from_plain, to_plain
from app.bridge.convert.types import message_type
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic

Endpoint = TypeVar("Endpoint")

MAX_BYTES = 256 << 20
"""Larger than any image or point cloud in use."""


class TopicPublisher:
    """``TopicPublisher(ros, "PoseStamped", "~/target").publish({"pose": {...}})``, lengths in mm.

    Subscriptions with incompatible quality of service are logged and listed in
    `RosNode.incompatible`.
    """

    def __init__(self, ros: RosNode, kind: str | type, name: str, qos: QoSProfile = STREAM) -> None:
        self.topic = Topic(name, message_type(kind), qos)
        self.count = 0
        self._ros = ros
        self._publisher = create_endpoint(lambda: ros.publisher(self.topic), name)

    def publish(self, values: Mapping[str, Any] | Any) -> int:
        """Publish plain values or a message; returns the number of subscribers before.

        Raises `ConversionError` and publishes nothing if a value does not fit its field.
        """
        if not isinstance(values, self.topic.type):
            values = from_plain(self.topic.type, values)
        subscribers = int(self._publisher.get_subscription_count())
        self._publisher.publish(values)
        self.count += 1
        return subscribers

    def close(self) -> None:
        """Destroy the publisher. Closing the node does this as well."""
        self._ros.call(lambda: self._ros.destroy_publisher(self._publisher))


class TopicSubscriber:
    """Keeps the last message of a topic; calls ``changed()`` in the node's thread for each one.

    Messages are deserialised only when `message` or `values` is read, so high rates cost little.
    Messages over 256 MB are ignored and counted in `too_long`.
    """

    def __init__(
        self,
        ros: RosNode,
        kind: str | type,
        name: str,
        qos: QoSProfile = STREAM,
        *,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.topic = Topic(name, message_type(kind), qos)
        self.count = 0
        self.too_long = 0
        self._changed = changed
        self._lock = threading.Lock()
        self._raw: bytes | None = None
        self._message: Any = None
        create_endpoint(lambda: ros.subscribe(self.topic, self._on_message, raw=True), name)

    @property
    def message(self) -> Any:
        """The last message (lengths in m); None before the first.

        Raises `ConversionError` if the bytes are not a message of the type.
        """
        with self._lock:
            if self._raw is not None:
                raw, self._raw, self._message = self._raw, None, None
                self._message = read_message(raw, self.topic)
            return self._message

    @property
    def values(self) -> Plain | None:
        """The last message as plain values, lengths in mm; None before the first."""
        message = self.message
        return None if message is None else to_plain(message)

    def _on_message(self, raw: bytes) -> None:
        if len(raw) > MAX_BYTES:
            self.too_long += 1
            return
        with self._lock:
            self._raw = raw
            self.count += 1
        self._changed()


def read_message(raw: bytes, topic: Topic) -> Any:
    """Deserialise ``raw``; raises `ConversionError` if it is not a message of the topic's type."""
    try:
        return deserialize_message(raw, topic.type)
    except Exception as error:  # rclpy raises several unrelated types for invalid bytes
        raise ConversionError(
            f"{topic.name}: {len(raw)} bytes are not a valid {topic.type.__name__}: "
            f"{' '.join(str(error).split())}"
        ) from error


def create_endpoint(create: Callable[[], Endpoint], name: str) -> Endpoint:
    """Call ``create()`` for topic ``name``; raises `ConversionError` if rclpy refuses."""
    try:
        return create()
    except Exception as error:  # rclpy raises an unrelated type for each problem
        raise ConversionError(
            f"topic {name!r} cannot be used: {' '.join(str(error).split())}"
        ) from error
