"""Devices on the graph as the hand of a world: a haptic one with the names of CRTK, a joystick.

=============================== ========================= =======================================
``NAMESPACE/measured_cp``       geometry_msgs/PoseStamped input: the handle; stamps are host time
``NAMESPACE/servo_cf``          geometry_msgs/            the force on the handle, in the frame of
                                WrenchStamped             ``measured_cp``; torques are 0
=============================== ========================= =======================================

A handle whose pose is older than the period for which the spring is passive is let go, and so is
one whose force would be later than that. The force is then 0, and the tool is taken anew.
"""

import math
import time
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Joy

from app.bridge.arm_inputs import NewestMessage
from app.bridge.messages import MM_PER_M, header_message, ns_of, vector_message
from app.bridge.node import RosNode
from app.bridge.sender_names import SingleSender
from app.bridge.topics import INCOMING, NEWEST, Topic
from app.geometry import (
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    Stamp,
    freshness_of,
)
from app.simulation import DeviceEntry, HapticCoupling, JoyEntry, JoyHand, WorldState, Wrench


class DeviceHand:
    """The spring between the handle of ``entry`` and the tool ``tool``."""

    def __init__(self, ros: RosNode, entry: DeviceEntry, tool: str) -> None:
        self.tool = tool
        self._entry, self._node = entry, ros.node
        self._coupling = HapticCoupling(entry.haptic)
        self._max_gap_ns = round(entry.haptic.max_period_s * NS_PER_S)
        self._period_ns = round(entry.haptic.period_s * NS_PER_S)
        self._pose = NewestMessage(ros, f"{entry.namespace}/measured_cp", PoseStamped)
        self._force = ros.publisher(Topic(f"{entry.namespace}/servo_cf", WrenchStamped, NEWEST))
        self._frame = ""
        self._stepped_ns: int | None = None
        self._sent_ns: int | None = None
        self.problem = ""
        """The reason why the handle does not hold the tool; empty if it does."""

    def wrench(self, state: WorldState) -> Wrench:
        """The force of the spring on the tool in ``state``; sends the one on the handle if due."""
        now_ns, host_ns = time.monotonic_ns(), time.time_ns()
        gap_ns = 0 if self._stepped_ns is None else now_ns - self._stepped_ns
        self._stepped_ns = now_ns
        reason, handle_mm = self._handle(host_ns)
        if gap_ns > self._max_gap_ns:
            reason = f"a step was {gap_ns / NS_PER_S:.4f} s late"
        self._log(reason)
        if reason or handle_mm is None:
            self._coupling.release()
            self._send(np.zeros(3), now_ns, host_ns)
            return Wrench(np.zeros(3), np.zeros(3))
        turn = self._entry.world_from_device
        on_tool, on_handle = self._coupling.update(
            turn @ handle_mm, state.bodies[self.tool].translation_mm
        )
        self._send(turn.T @ on_handle, now_ns, host_ns)
        return Wrench(on_tool, np.zeros(3))

    def rest(self) -> None:
        """Let go of the tool and send a force of 0."""
        if self._coupling.is_coupled:
            self._sent_ns = None  # at once
        self._coupling.release()
        self._stepped_ns = None
        self._send(np.zeros(3), time.monotonic_ns(), time.time_ns())

    def _handle(self, host_ns: int) -> tuple[str, FloatArray | None]:
        """The problem of the handle's pose, or its position in mm along its own axes."""
        topic = f"{self._entry.namespace}/measured_cp"
        message: Any = self._pose.message()
        if message is None:
            return self._pose.problem() or f"{topic}: no pose", None
        place, stamp = message.pose.position, message.header.stamp
        position = np.array([place.x, place.y, place.z])
        if not all(math.isfinite(each) for each in position.tolist()):
            return f"{topic}: a position is not finite", None
        stamp_ns = ns_of(stamp)
        found = freshness_of(stamp_ns, host_ns, FreshnessLimits(self._max_gap_ns))
        if found is not Freshness.VALID:
            return f"{topic}: the pose is {found.value}", None
        self._frame = message.header.frame_id
        return "", MM_PER_M * position

    def _send(self, force_n: FloatArray, now_ns: int, host_ns: int) -> None:
        if self._sent_ns is not None and now_ns - self._sent_ns < self._period_ns:
            return
        self._sent_ns = now_ns
        message = WrenchStamped(header=header_message(self._frame, Stamp(host_ns)))
        message.wrench.force = vector_message(force_n)
        self._force.publish(message)

    def _log(self, reason: str) -> None:
        if reason == self.problem:
            return
        was_late, self.problem = bool(self.problem), reason
        if reason:
            self._node.get_logger().warning(f"haptic device let go: {reason}")
        elif was_late:
            self._node.get_logger().info("haptic device holds the tool")


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
