"""``/clock`` of a simulated world, for a graph on which no guard runs."""

import time
from typing import Final

from app.bridge import topics
from app.bridge.messages import clock_message
from app.bridge.node import RosNode
from app.bridge.sender_names import publishers_text
from app.geometry import Stamp

CONSTRAINT_TYPE: Final = "marginguard_msgs/msg/FixtureConstraint"

DISCOVERY_S: Final = 1.0
"""Nothing is published before, so that the nodes that run already are known."""

_CHECK_S = 0.2


class ClockTopic:
    """Publishes the time of the states on ``/clock`` until a guard or another clock appears.

    A guard judges ages on the clock of its host, and so does a controller; a clock that stands with
    the physics would make old data look fresh to nodes that use it. From then on nothing is
    published any more, and `problem` says why. Thread-safe.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._publisher = ros.publisher(topics.CLOCK)
        self._begins_s = time.monotonic() + DISCOVERY_S
        self._is_checked = False
        self.problem = ""
        """The reason why ``/clock`` is not published; empty if it is, or will be."""
        ros.every(_CHECK_S, self._check)

    def publish(self, stamp_ns: int) -> None:
        """Publish ``stamp_ns``, the stamp of the state on the clock of the host."""
        if self._is_checked and not self.problem:
            self._publisher.publish(clock_message(Stamp(stamp_ns)))

    def _check(self) -> None:
        """Look for guards and other clocks. Runs in the node's thread."""
        if self.problem or not self._ros.is_open:
            return
        self.problem = self._found()
        if self.problem:
            self._ros.node.get_logger().error(f"/clock is not published any more: {self.problem}")
        self._is_checked = time.monotonic() >= self._begins_s

    def _found(self) -> str:
        node = self._ros.node
        if node.count_publishers(topics.CLOCK.name) > 1:
            infos = node.get_publishers_info_by_topic(topics.CLOCK.name)
            return f"{publishers_text(infos)} publish it; expected one node"
        for name, types in node.get_topic_names_and_types():
            if CONSTRAINT_TYPE in types:
                infos = node.get_publishers_info_by_topic(name)
                if infos:
                    return f"{publishers_text(infos)} guards with {name}; expected no guard"
        return ""
