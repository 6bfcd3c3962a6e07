"""Publishes the wrench of a hand that a program computes, for a cooperative controller."""

from collections.abc import Callable

from geometry_msgs.msg import WrenchStamped

from app.bridge.messages import header_message, vector_message
from app.bridge.node import RosNode
from app.bridge.qos import NEWEST, Topic
from app.geometry import FloatArray, Stamp

HAND_NODE = "marginguard_hand"
PERIOD_S = 0.01
"""A controller does not use a wrench that is older than 30 ms."""


class HandPublisher:
    """Publishes ``force_n()`` on ``topic`` 100 times per second, in the thread of ``ros``.

    The force (3,) in N acts on the tool's tip, along the axes of ``frame``; the torque is 0. The
    stamp is the time of ``clock_ns``, the host's, at which it was computed. The last message, on
    `close`, has no force.
    """

    def __init__(
        self,
        ros: RosNode,
        topic: str,
        frame: str,
        force_n: Callable[[], FloatArray],
        *,
        clock_ns: Callable[[], int],
    ) -> None:
        self._frame, self._force_n, self._clock_ns = frame, force_n, clock_ns
        self._publisher = ros.publisher(Topic(topic, WrenchStamped, NEWEST))
        ros.every(PERIOD_S, self._publish)
        ros.on_close(lambda: self._send((0.0, 0.0, 0.0)))

    def _publish(self) -> None:
        self._send(self._force_n())

    def _send(self, force_n: "FloatArray | tuple[float, float, float]") -> None:
        message = WrenchStamped(header=header_message(self._frame, Stamp(self._clock_ns())))
        message.wrench.force = vector_message(force_n)
        self._publisher.publish(message)
