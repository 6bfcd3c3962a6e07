"""The plan that an arm executes now, for displays."""

from collections.abc import Callable

from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.topics import EXECUTED_PLAN

_LOOK_S = 1.0


class ExecutedPlan:
    """Calls ``changed(text)`` with the JSON of each plan whose execution begins, empty at its end.

    Of several nodes' plans the one that has begun last is the present one. A node that was killed
    has ended its execution when it has left the graph. ``changed`` is called in the thread of
    ``ros``, until that closes.
    """

    def __init__(self, ros: RosNode, changed: Callable[[str], None]) -> None:
        self._ros, self._changed = ros, changed
        self._plans: dict[bytes | None, str] = {}
        self._known: set[bytes] = set()
        """Publishers that were in the graph. With Cyclone DDS senders have other identifiers."""
        self._text = ""
        ros.subscribe_with_origin(EXECUTED_PLAN, self._receive)
        ros.every(_LOOK_S, self._look)

    def _receive(self, data: bytes, origin: Origin) -> None:
        self._plans.pop(origin.sender, None)
        text = deserialize_message(data, String).data
        if text:
            self._plans[origin.sender] = text
        self._known |= self._present()
        self._show()

    def _look(self) -> None:
        present = self._present()
        gone = self._plans.keys() & self._known - present if present else set(self._plans)
        for sender in gone:
            del self._plans[sender]
        self._known = present
        self._show()

    def _present(self) -> set[bytes]:
        infos = self._ros.node.get_publishers_info_by_topic(EXECUTED_PLAN.name)
        return {bytes(each.endpoint_gid) for each in infos}

    def _show(self) -> None:
        text = next(reversed(self._plans.values()), "")
        if text != self._text:
            self._text = text
            self._changed(text)
