"""The plan that an arm executes now, for displays."""

from collections.abc import Callable

from app.bridge.node import RosNode
from app.bridge.topics import EXECUTED_PLAN

_LOOK_S = 1.0


class ExecutedPlan:
    """Calls ``changed(text)`` with the JSON of each plan whose execution begins, empty at its end.

    A node that was killed has ended its execution when it has left the graph. ``changed`` is called
    in the thread of ``ros``, until that closes.
    """

    def __init__(self, ros: RosNode, changed: Callable[[str], None]) -> None:
        self._ros, self._changed = ros, changed
        self._text = ""
        ros.subscribe(EXECUTED_PLAN, lambda message: self._use(message.data))
        ros.every(_LOOK_S, self._look)

    def _look(self) -> None:
        if self._text and not self._ros.node.count_publishers(EXECUTED_PLAN.name):
            self._use("")

    def _use(self, text: str) -> None:
        if text != self._text:
            self._text = text
            self._changed(text)
