"""Publish and receive transforms on ``/tf`` and ``/tf_static``."""

import threading
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from app.bridge import messages, topics
from app.bridge.message_origin import Origin, sender_of
from app.bridge.node import RosNode
from app.bridge.tf import TransformBuffer
from app.bridge.tf_poses import TfMessageReader
from app.bridge.topics import ANY_CLOCK, INCOMING, INCOMING_TF, STATIC_TF
from app.geometry import MarginGuardError, Stamp, Transform

_MAX_BYTES = 1 << 20
"""Room for a thousand transforms with long names."""

_MAX_CHARS = 200

_MAX_FRAMES = 4096


def tf_message(samples: Iterable[tuple[Transform, Stamp]]) -> TFMessage:
    """Convert ``samples`` to one message, with lengths in m."""
    return TFMessage(
        transforms=[messages.transform_message(transform, stamp) for transform, stamp in samples]
    )


class TfListener:
    """Fills ``buffer`` until the node is closed.

    Messages and samples that are invalid are ignored; `refused` counts them by type of error and
    `last_refusal` describes the latest one. ``received()`` is called in the node's thread after
    every readable message. A jump back of ``/clock`` discards all but the static edges; ``clock``
    False does not subscribe to ``/clock``. ``qos`` is that of ``/tf``. By default it is reliable as
    in tf2, so best-effort broadcasters are not received, which is logged.
    """

    def __init__(
        self,
        ros: RosNode,
        buffer: TransformBuffer,
        *,
        received: Callable[[], None] | None = None,
        clock: bool = True,
        qos: QoSProfile = INCOMING_TF,
    ) -> None:
        self.buffer = buffer
        self.messages = 0
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self._received = received
        self._read = TfMessageReader()
        moving = replace(topics.TF, qos=qos)
        static = replace(topics.TF_STATIC, qos=STATIC_TF)
        ros.subscribe(moving, lambda raw: self._take(raw, static=False), raw=True)
        ros.subscribe(static, lambda raw: self._take(raw, static=True), raw=True)
        if clock:
            ros.subscribe(replace(topics.CLOCK, qos=ANY_CLOCK), self._take_clock)

    def _take(self, raw: bytes, *, static: bool) -> None:
        self.messages += 1
        if len(raw) > _MAX_BYTES:
            self._refuse(
                "TooLong", f"a tf message has {len(raw)} bytes; expected at most {_MAX_BYTES}"
            )
            return
        try:
            samples = self._read(raw)
        except MarginGuardError as error:
            self._refuse(type(error).__name__, str(error))
            return
        for parent, child, stamp_ns, pose in samples:
            try:
                self.buffer.insert(parent, child, stamp_ns, pose, static=static)
            except MarginGuardError as error:
                self._refuse(type(error).__name__, str(error))
        if self._received is not None:
            self._received()

    def _take_clock(self, message: Clock) -> None:
        self.buffer.set_now(messages.ns_of(message.clock))

    def _refuse(self, kind: str, reason: str) -> None:
        self.refused[kind] += 1
        self.last_refusal = reason[:_MAX_CHARS]


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
