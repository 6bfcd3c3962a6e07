"""Any topic, in and out, with plain values: what a user of a scene asks for by name and type."""

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

Made = TypeVar("Made")

MOST_BYTES = 256 << 20
"""More than any image or cloud of an operating room."""


class TopicPublisher:
    """``TopicPublisher(ros, "PoseStamped", "~/target").publish({"pose": {...}})``, lengths in mm.

    Another endpoint that does not hear it because of its quality of service is said in the log,
    and in `RosNode.incompatible`.
    """

    def __init__(self, ros: RosNode, kind: str | type, name: str, qos: QoSProfile = STREAM) -> None:
        self.topic = Topic(name, message_type(kind), qos)
        self.count = 0
        self._ros = ros
        self._publisher = made(lambda: ros.publisher(self.topic), name)

    def publish(self, values: Mapping[str, Any] | Any) -> int:
        """Send plain values, or a message as it is; gives the number of subscribers.

        Raises `ConversionError`, with nothing sent, for a value that does not fit its field.
        """
        if not isinstance(values, self.topic.type):
            values = from_plain(self.topic.type, values)
        self._publisher.publish(values)
        self.count += 1
        return int(self._publisher.get_subscription_count())

    def close(self) -> None:
        """Leave the graph; needed only before the node itself is closed."""
        self._ros.call(lambda: self._ros.withdraw(self._publisher))


class TopicSubscriber:
    """Keeps the last message of a topic; ``changed()`` is called in the node's thread for each.

    Messages are taken as bytes and read only when somebody asks for one, so that ten thousand a
    second cost next to nothing. Those over 256 MB are left out and counted in `too_long`.
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
        made(lambda: ros.subscribe(self.topic, self._take, raw=True), name)

    @property
    def message(self) -> Any:
        """The last message as ROS has it (lengths in m); None before the first.

        Raises `ConversionError` for bytes that are no message of the type.
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

    def _take(self, raw: bytes) -> None:
        if len(raw) > MOST_BYTES:
            self.too_long += 1
            return
        with self._lock:
            self._raw = raw
            self.count += 1
        self._changed()


def read_message(raw: bytes, topic: Topic) -> Any:
    """The message in ``raw``; raises `ConversionError` for bytes that are none of the type."""
    try:
        return deserialize_message(raw, topic.type)
    except Exception as error:  # whatever rclpy makes of a stranger's bytes
        raise ConversionError(
            f"{topic.name}: {len(raw)} bytes are no {topic.type.__name__}: "
            f"{' '.join(str(error).split())}"
        ) from error


def made(make: Callable[[], Made], name: str) -> Made:
    """What ``make()`` gives for topic ``name``; raises `ConversionError` where it cannot be."""
    try:
        return make()
    except Exception as error:  # rclpy has an unrelated type for each way to be invalid
        raise ConversionError(f"no topic {name!r}: {' '.join(str(error).split())}") from error
