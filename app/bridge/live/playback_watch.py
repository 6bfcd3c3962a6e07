"""Detect a playback of a recording on the graph of a live session."""

import time
from collections.abc import Collection

from rclpy.node import NodeNameNonExistentError
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.node import RosNode
from app.bridge.sender_names import node_name

LINGER_S = 1.0
"""Time after the end of a playback for which it counts as found: its last samples may wait."""

CHECK_S = 0.1
"""Period in which publishers of the inputs are looked for that may be bag players."""

BAG_PLAYER = "rosbag2_player"
"""Beginning of the name that ``ros2 bag play`` gives its node."""

BAG_SERVICES = frozenset({"get_rate", "burst"})
"""Services that ``ros2 bag play`` offers below the name of its node, whatever that is."""

_MAX_CHARS = 200


class PlaybackWatch:
    """``found()`` describes the playback that is on the graph now.

    A playback exists as long as its announcement has a publisher, or as long as ``ros2 bag play``
    publishes on one of the ``inputs`` of the session. The endpoints of a killed process leave the
    graph when its lease has expired, after 20 s at most with Fast DDS. The text of the announcement
    only adds the name of the case: it may arrive later, or never.

    `check` looks for bag players; call it in the node's thread, before the first sample of a new
    sender is used. Otherwise it is called every `CHECK_S`. `found` is thread-safe.
    """

    def __init__(self, ros: RosNode, inputs: Collection[str]) -> None:
        self._ros = ros
        self._inputs = tuple(inputs)
        self._case = ""
        self._player = ""
        self._last_player = ""
        self._seen_s: float | None = None
        ros.subscribe(topics.PLAYBACK, self._receive)
        self._timer = ros.every(CHECK_S, self.check)

    def check(self) -> None:
        """Look for a bag player among the publishers of the inputs."""
        if not self._ros.is_open:
            return
        players = {
            node_name(info)
            for topic in self._inputs
            for info in self._ros.node.get_publishers_info_by_topic(topic)
            if self._is_player(info.node_name, info.node_namespace)
        }
        self._player = min(players, default="")

    def found(self) -> str:
        """Description of the playback; empty if there is none."""
        now_s, player, seen_s = time.monotonic(), self._player, self._seen_s
        if player:
            self._last_player = player
        is_announced = self._ros.is_open and self._ros.node.count_publishers(topics.PLAYBACK.name)
        if player or is_announced:
            self._seen_s = seen_s = now_s
        if seen_s is None:  # the text may arrive before its publisher is on the graph: keep it
            return ""
        if now_s - seen_s > LINGER_S:
            self._case, self._last_player, self._seen_s = "", "", None
            return ""
        last = self._last_player
        details = f"played by the node {last}" if last else self._case
        return f"poses from a recording, {details}" if details else "poses from a recording"

    def close(self) -> None:
        """Stop looking for bag players."""
        self._timer.cancel()

    def _is_player(self, name: str, namespace: str) -> bool:
        if name.startswith(BAG_PLAYER):
            return True
        if name == UNKNOWN_NODE:
            return False
        try:
            services = self._ros.node.get_service_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:  # it has left
            return False
        own = f"{namespace.rstrip('/')}/{name}/"
        return {each.removeprefix(own) for each, _ in services} >= BAG_SERVICES

    def _receive(self, message: String) -> None:
        text = message.data[:_MAX_CHARS]
        self._case = "".join(each if each.isprintable() else " " for each in text)
