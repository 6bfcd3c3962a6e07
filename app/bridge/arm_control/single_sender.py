"""The newest message of a topic, as long as a single publisher sends."""

import threading
import time
from collections.abc import Callable

from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.bridge.sender_names import node_name, nodes_text
from app.geometry import NS_PER_MS
from app.session import Sample, SenderTrail

MAX_BYTES = 1 << 20
_CHECK_PERIOD_NS = 100 * NS_PER_MS


class SingleSender:
    """Receives ``topic`` and calls ``receive(data)`` in the node's thread for its one sender.

    While two publishers send nothing is received, and `problem` names them. Thread-safe.
    """

    def __init__(self, ros: RosNode, topic: Topic, receive: Callable[[bytes], None]) -> None:
        self._node, self._name, self._receive = ros.node, topic.name, receive
        self._trail, self._lock = SenderTrail(), threading.Lock()
        self._checked_ns: int | None = None
        self._problem = ""
        ros.subscribe_with_origin(topic, self._take)

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
            infos = self._node.get_publishers_info_by_topic(self._name)
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
                is_used = is_used and not self._trail.conflict
            if not is_used:
                return
        self._receive(data)
