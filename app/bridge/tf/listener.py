"""``/tf`` and ``/tf_static`` into a buffer, as raw bytes: no Python message objects on the way."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from app.bridge import topics
from app.bridge.node import RosNode
from app.bridge.qos import ANY_CLOCK, INCOMING_TF, STATIC_TF
from app.bridge.tf.buffer import TransformBuffer
from app.bridge.tf.wire import TfMessageReader
from app.geometry import NS_PER_S, MarginGuardError

_MOST_BYTES = 1 << 20
"""A thousand transforms with long names; more in one message is no tree of frames."""

_MOST_WORDS = 200


class TfListener:
    """Fills ``buffer`` from the moment that it is made until the node is closed.

    What cannot be read or inserted is left out, and `refused` counts it by the kind of error;
    `last_refusal` is the latest one in words. ``received()``, when given, is called in the node's
    thread after every message that brought something. A ``/clock`` that jumps back empties the
    buffer but for static edges; with ``clock`` False nobody's ``/clock`` is heard. ``qos`` is what
    is asked of ``/tf``: as tf2 asks, so that broadcasters which do not promise delivery are not
    heard, and said in the log.
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
        if len(raw) > _MOST_BYTES:
            self._refuse("TooLong", f"a tf message has {len(raw)} bytes: {_MOST_BYTES} allowed")
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
        self.buffer.set_now(message.clock.sec * NS_PER_S + message.clock.nanosec)

    def _refuse(self, kind: str, words: str) -> None:
        self.refused[kind] += 1
        self.last_refusal = words[:_MOST_WORDS]
