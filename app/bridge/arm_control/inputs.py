"""Measured inputs of the controller of an arm: its joints and the hand's wrench.

Messages are deserialised when they are used, because only the newest one matters.
"""

import threading
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from app.bridge.arm_control.single_sender import SingleSender
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.control import JointMeasurement, WrenchMeasurement
from app.geometry import NS_PER_S


class NewestMessage:
    """The newest message of the topic ``name`` of one sender. Thread-safe."""

    def __init__(self, ros: RosNode, name: str, kind: type) -> None:
        self._kind, self._lock = kind, threading.Lock()
        self._data: bytes | None = None
        self._message: Any = None
        self.refused = 0
        """Number of messages that could not be read."""
        self._sender = SingleSender(ros, Topic(name, kind, INCOMING), self._take)

    def problem(self) -> str:
        """The problem that forbids the use of the messages; empty without one."""
        return self._sender.problem()

    def message(self) -> Any:
        """The newest message; None before the first, after an invalid one and for two senders."""
        if self.problem():
            return None
        with self._lock:
            data, self._data = self._data, None
        if data is not None:
            try:
                self._message = deserialize_message(data, self._kind)
            except Exception:  # rclpy raises several unrelated types for invalid bytes
                self._message = None
                self.refused += 1
        return self._message

    def _take(self, data: bytes) -> None:
        with self._lock:
            self._data = data


class ArmInputs:
    """Joints of ``arm`` and the wrench on ``hand_topic``."""

    def __init__(self, ros: RosNode, arm: str, hand_topic: str, *, hand_in_tool: bool) -> None:
        self._in_tool = hand_in_tool
        self._joints = NewestMessage(ros, f"{arm}/measured_js", JointState)
        self._wrench = NewestMessage(ros, hand_topic, WrenchStamped)

    def joints(self) -> JointMeasurement | None:
        """The newest joint positions, with the stamp of their message."""
        message = self._joints.message()
        if message is None:
            return None
        return JointMeasurement(
            _ns(message.header.stamp), tuple(message.name), tuple(message.position)
        )

    def wrench(self) -> WrenchMeasurement | None:
        """The hand's newest wrench, with the stamp of its message."""
        message = self._wrench.message()
        if message is None:
            return None
        force, torque = message.wrench.force, message.wrench.torque
        return WrenchMeasurement(
            _ns(message.header.stamp),
            np.array([force.x, force.y, force.z]),
            np.array([torque.x, torque.y, torque.z]),
            self._in_tool,
        )

    def problems(self) -> list[str]:
        """Topics with more than one sender."""
        return [text for each in (self._joints, self._wrench) if (text := each.problem())]


def _ns(stamp: Any) -> int:
    return int(stamp.sec * NS_PER_S + stamp.nanosec)
