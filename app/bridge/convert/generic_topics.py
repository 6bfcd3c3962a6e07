"""Publishers and subscriptions for any topic, given by name and type, with plain values."""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from app.bridge.convert.plain import Plain, from_plain, message_type, to_plain
from app.bridge.node import RosNode
from app.bridge.ros_errors import ConversionError, reason_of
from app.bridge.topics import STREAM, Topic

Endpoint = TypeVar("Endpoint")

MAX_BYTES = 256 << 20
"""Larger than any image or point cloud in use."""

_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}
_DURABILITY = {
    "volatile": DurabilityPolicy.VOLATILE,
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
}
_MAX_DEPTH = 10_000


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
            f"{reason_of(error)}"
        ) from error


def create_endpoint(create: Callable[[], Endpoint], name: str) -> Endpoint:
    """Call ``create()`` for topic ``name``; raises `ConversionError` if rclpy refuses."""
    try:
        return create()
    except Exception as error:  # rclpy raises an unrelated type for each problem
        raise ConversionError(f"topic {name!r} cannot be used: {reason_of(error)}") from error


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


def qos_profile(
    *, depth: int = 10, reliability: str = "reliable", durability: str = "volatile"
) -> QoSProfile:
    """QoS profile that keeps the last ``depth`` messages; ``transient_local`` means latched.

    Raises `ConversionError` for an unknown policy and a depth out of range.
    """
    if not 1 <= depth <= _MAX_DEPTH:
        raise ConversionError(f"depth is {depth}; expected 1 to {_MAX_DEPTH}")
    if reliability not in _RELIABILITY:
        raise ConversionError(
            f"reliability is {reliability!r}; expected {' or '.join(_RELIABILITY)}"
        )
    if durability not in _DURABILITY:
        raise ConversionError(f"durability is {durability!r}; expected {' or '.join(_DURABILITY)}")
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=_RELIABILITY[reliability],
        durability=_DURABILITY[durability],
    )
