"""A topic whose every message is wanted, in order, by a thread that comes for them when it can."""

import threading
from collections import deque
from typing import Any

from rclpy.qos import QoSProfile

from app.bridge.convert.topics import MOST_BYTES, made, read_message
from app.bridge.convert.types import message_type
from app.bridge.node import RosNode
from app.bridge.qos import Topic


class TopicQueue:
    """The messages since the last `take`, as bytes: at most as many as ``qos.depth``.

    A newer one takes the place of the oldest in a full queue, and `lost` counts that; it does not
    count what DDS, whose own queue is as long, lets go before the node's thread comes for it.
    Messages over 256 MB are left out and counted in `too_long`.
    """

    def __init__(self, ros: RosNode, kind: str | type, name: str, qos: QoSProfile) -> None:
        self.topic = Topic(name, message_type(kind), qos)
        self.lost = 0
        self.too_long = 0
        self._ros = ros
        self._lock = threading.Lock()
        self._raws: deque[bytes] = deque()
        self._subscription = made(lambda: ros.subscribe(self.topic, self._take_in, raw=True), name)

    def take(self) -> list[bytes]:
        """What has come, the oldest first; `read` makes a message of each."""
        with self._lock:
            raws = list(self._raws)
            self._raws.clear()
        return raws

    def read(self, raw: bytes) -> Any:
        """One of them as ROS has it (lengths in m); raises `ConversionError`."""
        return read_message(raw, self.topic)

    def close(self) -> None:
        """Leave the graph; needed only before the node itself is closed."""
        self._ros.call(lambda: self._ros.unsubscribe(self._subscription))

    def _take_in(self, raw: bytes) -> None:
        if len(raw) > MOST_BYTES:
            self.too_long += 1
            return
        with self._lock:
            self._raws.append(raw)
            if len(self._raws) > self.topic.qos.depth:
                self._raws.popleft()
                self.lost += 1
