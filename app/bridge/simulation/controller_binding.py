"""The one controller that moves an arm: the node of its first command."""

import threading
from collections.abc import Iterable, Sequence

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.sender_names import nodes_text, publishers_text

_PARTICIPANT_BYTES = 12
"""The part of a publisher's identifier that the publishers of one process have in common."""


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
