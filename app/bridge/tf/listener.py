"""Subscribe to ``/tf`` and ``/tf_static`` and fill a buffer, without Python message objects."""

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

_MAX_BYTES = 1 << 20
"""Room for a thousand transforms with long names."""

_MAX_CHARS = 200


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
        self.buffer.set_now(message.clock.sec * NS_PER_S + message.clock.nanosec)

    def _refuse(self, kind: str, reason: str) -> None:
        self.refused[kind] += 1
        self.last_refusal = reason[:_MAX_CHARS]
