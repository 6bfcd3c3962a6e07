"""Detect a playback of a recording on the graph of a live session."""

import time

from std_msgs.msg import String

from app.bridge import topics
from app.bridge.node import RosNode

LINGER_S = 1.0
"""Time after the end of a playback for which it counts as found: its last samples may wait."""

_MAX_CHARS = 200


class PlaybackWatch:
    """``found()`` describes the playback that is on the graph now.

    A playback exists as long as its announcement has a publisher. The endpoints of a killed
    process leave the graph when its lease has expired, after 20 s at most with Fast DDS. The text
    of the announcement only adds the name of the case: it may arrive later, or never.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._case = ""
        self._seen_s: float | None = None
        ros.subscribe(topics.PLAYBACK, self._receive)

    def found(self) -> str:
        """Description of the playback; empty if there is none."""
        now_s = time.monotonic()
        if self._ros.is_open and self._ros.node.count_publishers(topics.PLAYBACK.name):
            self._seen_s = now_s
        if self._seen_s is None or now_s - self._seen_s > LINGER_S:
            self._seen_s, self._case = None, ""
            return ""
        return f"poses from a recording, {self._case}" if self._case else "poses from a recording"

    def _receive(self, message: String) -> None:
        text = message.data[:_MAX_CHARS]
        self._case = "".join(each if each.isprintable() else " " for each in text)
