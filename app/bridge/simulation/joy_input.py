"""A joystick or 3D mouse on the graph as the hand of a world."""

import time

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Joy

from app.bridge.arm_control.single_sender import SingleSender
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.simulation import JoyEntry, JoyHand


class JoyInput:
    """Passes the axes of the topic of ``entry`` to `hand`, while a single node sends them."""

    def __init__(self, ros: RosNode, entry: JoyEntry, tool: str, force_n: float) -> None:
        self.hand = JoyHand(entry, tool, force_n, time.monotonic_ns)
        self._name, self._logger = entry.topic, ros.node.get_logger()
        self._problem = ""
        self._sender = SingleSender(ros, Topic(entry.topic, Joy, INCOMING), self._take)

    def _take(self, data: bytes) -> None:
        try:
            axes = list(deserialize_message(data, Joy).axes)
        except Exception:  # rclpy raises several unrelated types for invalid bytes
            problem = self.hand.take([]) and "a message cannot be read; expected sensor_msgs/Joy"
        else:
            problem = self.hand.take(axes)
        if problem and problem != self._problem:
            self._logger.warning(f"{self._name}: {problem}; the hand's force is 0")
        self._problem = problem
