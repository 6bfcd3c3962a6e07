"""Commands to one simulated arm, from the topics of CRTK, and who sends them."""

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState

from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.message_origin import Origin, ReceiveFrom
from app.bridge.messages import MM_PER_M, ns_of
from app.bridge.node import RosNode
from app.bridge.sender_names import nodes_text, publishers_text
from app.bridge.topics import MOTION, NEWEST, Topic
from app.simulation import (
    ArmCommand,
    JointPositionCommand,
    JointVelocityCommand,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
)

_PARTICIPANT_BYTES = 12
"""The part of a publisher's identifier that the publishers of one process have in common."""

MAX_AHEAD_NS = 5_000_000
"""A command may be stamped as much ahead: physics and sender are two processes."""

_MAX_BYTES = 1 << 20


class ControllerBinding:
    """Binds the arm whose motion topics are ``topics`` to the node of its first command.

    The binding outlives its node: another one is refused, also when the first has ended, until
    `release`. One node may publish on several topics. With a middleware whose messages name their
    publishers in another way than the graph (Cyclone DDS) a node may use one topic only. A message
    without an origin (another build of ROS) is bound by the graph alone. Thread-safe.
    """

    def __init__(self, node: Node, topics: Sequence[str]) -> None:
        self._node, self._topics = node, tuple(topics)
        self._lock = threading.Lock()
        self._is_bound = False
        self._sender: bytes | None = None
        self._bound: TopicEndpointInfo | None = None
        self._other: bytes | None = None

    @property
    def is_due(self) -> bool:
        """True if `problem` has to look at once: for the node that was bound, or another one."""
        return self._other is not None or (self._is_bound and self._bound is None)

    def accepts(self, sender: bytes | None) -> bool:
        """True for a command of the bound controller; the first command binds.

        ``sender`` identifies the publisher (`Origin`). After a message of another controller all
        are refused until `release`.
        """
        with self._lock:
            if self._other is not None:
                return False
            self._is_bound = True
            if sender is None:
                return True
            if self._sender is None:
                self._sender = sender[:_PARTICIPANT_BYTES]
            if self._sender != sender[:_PARTICIPANT_BYTES]:
                self._other = sender
            return self._other is None

    def problem(self) -> str:
        """Evidence that a controller other than the bound one may move the arm; empty without."""
        counts = {name: self._node.count_publishers(name) for name in self._topics}
        for name, count in counts.items():
            if count > 1:
                return f"{name} has {count} publishers; expected 1"
        used = [name for name, count in counts.items() if count]
        infos = [each for name in used for each in self._node.get_publishers_info_by_topic(name)]
        nodes = _distinct(infos)
        if len(nodes) > 1:
            names = publishers_text(infos)
            return f"{' and '.join(used)} have {len(nodes)} senders ({names}); expected 1"
        with self._lock:
            if self._other is not None:
                return self._text(infos, self._other)
            if not self._is_bound or not infos:
                return ""
            if self._bound is None or (_is_same(self._bound, infos[0]) and not _name(self._bound)):
                self._bound = infos[0]
            return "" if _is_same(self._bound, infos[0]) else self._text(infos, None)

    def release(self) -> None:
        """Bind the arm to the node of the next command."""
        with self._lock:
            self._is_bound = False
            self._sender = self._bound = self._other = None

    def _text(self, infos: Iterable[TopicEndpointInfo], sender: bytes | None) -> str:
        others = [each for each in infos if sender is None or _gid(each) == sender]
        other = publishers_text(others) if others else nodes_text([], 1)
        bound = publishers_text([self._bound]) if self._bound else nodes_text([], 1)
        return f"another controller commands the arm ({other}); expected {bound}, its first one"


def _gid(info: TopicEndpointInfo) -> bytes:
    return bytes(info.endpoint_gid)


def _name(info: TopicEndpointInfo) -> str:
    """Full name of the node; empty while it is not known."""
    known = info.node_name != UNKNOWN_NODE
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}" if known else ""


def _is_same(first: TopicEndpointInfo, second: TopicEndpointInfo) -> bool:
    """True if both are publishers of one node, as far as the names are known."""
    if _gid(first)[:_PARTICIPANT_BYTES] != _gid(second)[:_PARTICIPANT_BYTES]:
        return False
    return not _name(first) or not _name(second) or _name(first) == _name(second)


def _distinct(infos: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
    """One publisher of each node."""
    found: list[TopicEndpointInfo] = []
    for info in infos:
        if not any(_is_same(info, each) for each in found):
            found.append(info)
    return found


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


READERS: dict[str, tuple[type, Callable[[int, Any], ArmCommand]]] = {
    "servo_jv": (
        JointState,
        lambda ns, each: JointVelocityCommand(ns, tuple(each.name), tuple(each.velocity)),
    ),
    "servo_jp": (
        JointState,
        lambda ns, each: JointPositionCommand(ns, tuple(each.name), tuple(each.position)),
    ),
    "servo_cp": (PoseStamped, _tool_pose),
    "servo_cv": (TwistStamped, _tool_twist),
    "servo_cf": (WrenchStamped, _base_wrench),
    "body/servo_cf": (
        WrenchStamped,
        lambda ns, each: replace(_base_wrench(ns, each), in_tool=True),
    ),
}
"""Topic in the arm's namespace -> message type, and the command that a message is."""


class ArmCommands:
    """Receives the commands to the arm ``name``; the newest to arrive counts."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._node = ros.node
        self._lock = threading.Lock()
        self._arrived: tuple[str, Any, int] | None = None
        topics = [f"/{name}/{each}" for each in MOTION]
        self.binding = ControllerBinding(ros.node, topics)
        self._problem = ""
        for topic, (kind, _) in READERS.items():
            ros.subscribe_with_origin(
                Topic(f"/{name}/{topic}", kind, NEWEST), self._taker(topic, kind)
            )

    def other_controller(self) -> str:
        """Evidence that another source than its controller may move this arm; empty without any."""
        problem = self.binding.problem()
        self._problem = problem or self._problem
        return problem

    def enabled(self, fault: str) -> None:
        """Accept the next controller if ``fault``, which has ended, was that of another one."""
        if fault and fault == self._problem:
            self._problem = ""
            self.binding.release()

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
        stamp_ns = ns_of(stamp)
        age_ns = min(arrived_ns - stamp_ns, 0)
        if age_ns >= -MAX_AHEAD_NS:
            age_ns = max(host_ns - stamp_ns, 0)
        _, read = READERS[topic]
        return read(time_ns - age_ns, message)

    def _taker(self, topic: str, kind: type) -> ReceiveFrom:
        def take(data: bytes, origin: Origin) -> None:
            """Keep a command of the controller. Runs in the node's thread."""
            now_ns = self._node.get_clock().now().nanoseconds
            if len(data) > _MAX_BYTES or not self.binding.accepts(origin.sender):
                return
            message = deserialize_message(data, kind)
            with self._lock:
                self._arrived = topic, message, now_ns

        return take
