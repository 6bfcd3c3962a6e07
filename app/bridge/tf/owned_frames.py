"""Broadcast frames on ``/tf`` that no other node broadcasts."""

import threading
from collections.abc import Iterable
from dataclasses import replace

from app.bridge import topics
from app.bridge.message_origin import Origin, sender_of
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, STATIC_TF
from app.bridge.tf.broadcaster import tf_message
from app.bridge.tf.wire import TfMessageReader
from app.geometry import MarginGuardError, Stamp, Transform

_MAX_BYTES = 1 << 20
_MAX_FRAMES = 4096


class OwnedFrames:
    """Publishes frames as long as this node is their only publisher on ``/tf`` and ``/tf_static``.

    A frame has one owner: one that another node has published is refused for good. Where the
    middleware does not say who has sent a message, all frames that arrive before the first `send`
    of them belong to others. Thread-safe.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._lock = threading.Lock()
        self._publisher = ros.publisher(topics.TF)
        self._own = sender_of(self._publisher)
        self._sent: set[str] = set()
        self._others: set[str] = set()
        self._read = TfMessageReader()
        self._subscriptions = [
            ros.subscribe_with_origin(replace(topics.TF, qos=INCOMING), self._take),
            ros.subscribe_with_origin(replace(topics.TF_STATIC, qos=STATIC_TF), self._take),
        ]

    def send(self, poses: Iterable[Transform], stamp: Stamp) -> None:
        """Publish ``parent_from_child`` of each frame that is not another node's."""
        with self._lock:
            owned = [each for each in poses if each.source not in self._others]
            self._sent.update(each.source for each in owned)
        if owned:
            self._publisher.publish(tf_message((each, stamp) for each in owned))

    def refused(self, frames: Iterable[str]) -> frozenset[str]:
        """The subset of ``frames`` that another node publishes."""
        with self._lock:
            return frozenset(frames) & self._others

    def close(self) -> None:
        """Stop publishing and listening; from any thread."""
        self._ros.call(self._destroy)

    def _destroy(self) -> None:
        self._ros.destroy_publisher(self._publisher)
        for each in self._subscriptions:
            self._ros.destroy_subscription(each)

    def _take(self, data: bytes, origin: Origin) -> None:
        """Note the frames of others. Runs in the node's thread."""
        if len(data) > _MAX_BYTES or (origin.sender is not None and origin.sender == self._own):
            return
        try:
            frames = {each.child for each in self._read(data)}
        except MarginGuardError:  # the listener of tf reports invalid messages
            return
        with self._lock:
            if origin.sender is None or self._own is None:
                frames -= self._sent
            if len(self._others) < _MAX_FRAMES:
                self._others |= frames
