"""Commands to one simulated arm, from the topics of CRTK, and who sends them."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from app.bridge.message_origin import Origin, ReceiveFrom
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.qos import NEWEST, Topic
from app.bridge.simulation.controller_binding import ControllerBinding
from app.geometry import NS_PER_S
from app.simulation import (
    ArmCommand,
    JointPositionCommand,
    JointVelocityCommand,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
)

MAX_AHEAD_NS = 5_000_000
"""A command may be stamped as much ahead: physics and sender are two processes."""

OTHER_MOTION = ("move_jp", "move_jr", "move_cp", "interpolate_jp", "interpolate_cp")
"""Motion topics of CRTK that a simulated arm does not follow; a sender on them is a second one."""

_MAX_BYTES = 1 << 20


def _joint_velocity(stamp_ns: int, message: JointState) -> ArmCommand:
    return JointVelocityCommand(stamp_ns, tuple(message.name), tuple(message.velocity))


def _joint_position(stamp_ns: int, message: JointState) -> ArmCommand:
    return JointPositionCommand(stamp_ns, tuple(message.name), tuple(message.position))


def _tool_pose(stamp_ns: int, message: PoseStamped) -> ArmCommand:
    place, turn = message.pose.position, message.pose.orientation
    position_mm = (MM_PER_M * place.x, MM_PER_M * place.y, MM_PER_M * place.z)
    quaternion = (turn.x, turn.y, turn.z, turn.w)
    return ToolPoseCommand(stamp_ns, message.header.frame_id, position_mm, quaternion)


def _tool_twist(stamp_ns: int, message: TwistStamped) -> ArmCommand:
    linear, angular = message.twist.linear, message.twist.angular
    return ToolTwistCommand(
        stamp_ns,
        message.header.frame_id,
        (MM_PER_M * linear.x, MM_PER_M * linear.y, MM_PER_M * linear.z),
        (angular.x, angular.y, angular.z),
    )


def _base_wrench(stamp_ns: int, message: WrenchStamped) -> ToolWrenchCommand:
    force, torque = message.wrench.force, message.wrench.torque
    return ToolWrenchCommand(
        stamp_ns,
        message.header.frame_id,
        (force.x, force.y, force.z),
        (torque.x, torque.y, torque.z),
    )


def _tool_wrench(stamp_ns: int, message: WrenchStamped) -> ArmCommand:
    return replace(_base_wrench(stamp_ns, message), in_tool=True)


READERS: dict[str, tuple[type, Callable[[int, Any], ArmCommand]]] = {
    "servo_jv": (JointState, _joint_velocity),
    "servo_jp": (JointState, _joint_position),
    "servo_cp": (PoseStamped, _tool_pose),
    "servo_cv": (TwistStamped, _tool_twist),
    "servo_cf": (WrenchStamped, _base_wrench),
    "body/servo_cf": (WrenchStamped, _tool_wrench),
}
"""Topic in the arm's namespace -> message type, and the command that a message is."""


class ArmCommands:
    """Receives the commands to the arm ``name``; the newest to arrive counts."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._node = ros.node
        self._lock = threading.Lock()
        self._arrived: tuple[str, Any, int] | None = None
        topics = [f"/{name}/{each}" for each in (*READERS, *OTHER_MOTION)]
        self._binding = ControllerBinding(ros.node, topics)
        self._problem = ""
        for topic, (kind, _) in READERS.items():
            ros.subscribe_with_origin(
                Topic(f"/{name}/{topic}", kind, NEWEST), self._taker(topic, kind)
            )

    @property
    def is_check_due(self) -> bool:
        """True if `other_controller` has to look at once."""
        return self._binding.is_due

    def other_controller(self) -> str:
        """Evidence that another source than its controller may move this arm; empty without any."""
        problem = self._binding.problem()
        self._problem = problem or self._problem
        return problem

    def enabled(self, fault: str) -> None:
        """Accept the next controller if ``fault``, which has ended, was that of another one."""
        if fault and fault == self._problem:
            self._problem = ""
            self._binding.release()

    def newest(self, host_ns: int, time_ns: int) -> ArmCommand | None:
        """The command that has arrived since the last call, on the simulation's clock.

        ``host_ns`` and ``time_ns`` are the present on both clocks. A stamp that was in the future
        when the message arrived stays in the future, which the arm refuses. The present of a
        physics that was interrupted may be before the arrival.
        """
        with self._lock:
            arrived, self._arrived = self._arrived, None
        if arrived is None:
            return None
        topic, message, arrived_ns = arrived
        stamp = message.header.stamp
        stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
        age_ns = min(arrived_ns - stamp_ns, 0)
        if age_ns >= -MAX_AHEAD_NS:
            age_ns = max(host_ns - stamp_ns, 0)
        _, read = READERS[topic]
        return read(time_ns - age_ns, message)

    def _taker(self, topic: str, kind: type) -> ReceiveFrom:
        def take(data: bytes, origin: Origin) -> None:
            """Keep a command of the controller. Runs in the node's thread."""
            now_ns = self._node.get_clock().now().nanoseconds
            if len(data) > _MAX_BYTES or not self._binding.accepts(origin.sender):
                return
            message = deserialize_message(data, kind)
            with self._lock:
                self._arrived = topic, message, now_ns

        return take
