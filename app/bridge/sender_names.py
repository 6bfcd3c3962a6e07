"""Publishers of a topic on the graph: senders that are present, their nodes, a single one."""

import threading
import time
from collections.abc import Callable, Iterable

from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.topics import Topic
from app.geometry import NS_PER_MS
from app.session import Sample, SenderTrail

MAX_SHOWN = 4
"""Nodes that one text lists."""

MAX_BYTES = 1 << 20
"""Longer messages to a `SingleSender` are ignored."""

_CHECK_PERIOD_NS = 100 * NS_PER_MS
_MAX_NAMED = 64
_MAX_CHARS = 60


class SenderNames:
    """The publishers of one topic, as the graph listed them at the last `refresh` or later.

    A node's name is what the node announces; nothing verifies it. Names of publishers that have
    left are remembered. Not thread-safe.
    """

    def __init__(self, ros: RosNode, topic: str, own: Iterable[bytes | None] = ()) -> None:
        self._ros = ros
        self.topic = topic
        self._own = frozenset(each for each in own if each is not None)
        self._present: frozenset[bytes] = frozenset()
        self._names: dict[bytes, str] = {}
        self._has_matched = False
        self._is_outdated = self._has_unnamed = False

    def outdate(self) -> None:
        """Read the graph before the next answer; at once while a publisher has no name yet."""
        self._is_outdated = True
        if self._has_unnamed:
            self.refresh()

    def refresh(self) -> None:
        """Read the graph."""
        if not self._ros.is_open:
            return
        self._is_outdated = False
        infos = self._ros.node.get_publishers_info_by_topic(self.topic)
        self._present = frozenset(bytes(each.endpoint_gid) for each in infos)
        for each in infos:
            sender = bytes(each.endpoint_gid)
            if each.node_name != UNKNOWN_NODE and sender not in self._names:
                self._names[sender] = node_name(each)
                if len(self._names) > _MAX_NAMED:
                    del self._names[next(iter(self._names))]
        self._has_unnamed = any(each.node_name == UNKNOWN_NODE for each in infos)

    def is_own(self, sender: bytes | None) -> bool:
        """True if ``sender`` is a publisher of this node."""
        return sender in self._own

    def is_present(self, sender: object) -> bool:
        """True if the graph lists ``sender``.

        A middleware that identifies publishers and senders in different ways (Cyclone DDS) gives no
        answer: then any publisher of another node counts as the sender.
        """
        if self._is_outdated:
            self.refresh()
        if sender in self._present:
            self._has_matched = True
            return True
        return not self._has_matched and bool(self._present - self._own)

    def text(self, senders: Iterable[object]) -> str:
        """Names of the nodes of ``senders``; of all other publishers if none of those is known."""
        if self._is_outdated:
            self.refresh()
        asked = list(senders)
        found = [self._names[each] for each in asked if each in self._names]
        if not found:
            asked = list(self._present - self._own)
            found = [self._names[each] for each in asked if each in self._names]
        return nodes_text(found, len(asked) - len(found))


def nodes_text(names: Iterable[str], unknown: int = 0) -> str:
    """``nodes /a and /b``, with the number of those whose names are not known yet."""
    known = sorted(set(names))
    shown = known[:MAX_SHOWN]
    more = unknown + len(known) - len(shown)
    if more:
        shown.append(f"{more} more" if shown else "without a known name")
    return f"{'nodes' if len(known) + unknown > 1 else 'node'} {' and '.join(shown)}"


def publishers_text(infos: Iterable[TopicEndpointInfo]) -> str:
    """The nodes of publishers, as `nodes_text`; the name of a node may follow its publisher."""
    listed = list(infos)
    known = [node_name(each) for each in listed if each.node_name != UNKNOWN_NODE]
    return nodes_text(known, len(listed) - len(known))


def node_name(endpoint: TopicEndpointInfo) -> str:
    """Full name of the node of ``endpoint``, shortened and printable."""
    name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
    printable = "".join(each if each.isprintable() else "?" for each in name)
    return printable if len(printable) <= _MAX_CHARS else f"{printable[:_MAX_CHARS]}..."


class SingleSender:
    """Receives ``topic`` and calls ``receive(data)`` in the node's thread for its one sender.

    While two publishers send nothing is received, unless ``in_conflict``, and `problem` names them.
    With ``polled`` it receives in `poll`. Thread-safe.
    """

    def __init__(
        self,
        ros: RosNode,
        topic: Topic,
        receive: Callable[[bytes], None],
        *,
        in_conflict: bool = False,
        polled: bool = False,
    ) -> None:
        self._in_conflict, self._ros = in_conflict, ros
        self._name, self._receive = topic.name, receive
        self._trail, self._lock = SenderTrail(), threading.Lock()
        self._checked_ns: int | None = None
        self._problem = ""
        self._subscription = ros.subscribe_with_origin(topic, self._take, polled=polled)

    def poll(self) -> None:
        """Receive in this thread what has come."""
        self._ros.poll(self._subscription)

    def problem(self) -> str:
        """The problem that forbids the use of the messages; empty without one."""
        now_ns = time.monotonic_ns()
        with self._lock:
            if not self._trail.conflict:
                return ""
            is_due = self._checked_ns is None or now_ns - self._checked_ns >= _CHECK_PERIOD_NS
            if self._problem and not is_due:
                return self._problem
            self._checked_ns = now_ns
            infos = self._ros.node.get_publishers_info_by_topic(self._name)
            present = {bytes(info.endpoint_gid) for info in infos}
            conflict = self._trail.check(now_ns, present.__contains__)
            names = nodes_text(node_name(info) for info in infos)
            self._problem = ""
            if conflict:
                self._problem = (
                    f"{self._name}: {len(conflict)} publishers send ({names}); expected one"
                )
            return self._problem

    def _take(self, data: bytes, origin: Origin) -> None:
        if len(data) > MAX_BYTES:
            return
        if origin.sender is not None:
            with self._lock:
                is_used = self._trail.observe(origin.sender, Sample(0, data), time.monotonic_ns())
                is_used = is_used and (self._in_conflict or not self._trail.conflict)
            if not is_used:
                return
        self._receive(data)
