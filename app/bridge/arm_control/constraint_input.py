"""Constraints of the guard for a controller: the newest of each sender, in order of arrival."""

import threading
from collections import OrderedDict

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.bridge.arm_control.base_pose import Setup, setup_of
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.plain_constraint import plain_constraint
from app.bridge.qos import NEWEST, Topic
from app.fixture import PlainConstraint

MAX_BYTES = 1 << 20
_MAX_SENDERS = 8


class ConstraintInput:
    """Receives the topic ``name``. A second guard is not filtered: the rule has to see it."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._lock = threading.Lock()
        self._waiting: OrderedDict[bytes | None, bytes] = OrderedDict()
        self.refused = 0
        """Number of messages that could not be read."""
        ros.subscribe_with_origin(Topic(name, FixtureConstraint, NEWEST), self._take)

    def arrived(self) -> list[tuple[PlainConstraint, Setup | None]]:
        """The newest constraint of each sender that has sent since the last call, with its poses.

        The poses are None if they are not valid.
        """
        with self._lock:
            waiting, self._waiting = self._waiting, OrderedDict()
        found = []
        for data in waiting.values():
            try:
                message = deserialize_message(data, FixtureConstraint)
                found.append((plain_constraint(message), setup_of(message)))
            except Exception:  # rclpy raises several unrelated types for invalid bytes
                self.refused += 1
        return found

    def _take(self, data: bytes, origin: Origin) -> None:
        if len(data) > MAX_BYTES:
            self.refused += 1
            return
        with self._lock:
            self._waiting[origin.sender] = data
            self._waiting.move_to_end(origin.sender)
            while len(self._waiting) > _MAX_SENDERS:
                self._waiting.popitem(last=False)
