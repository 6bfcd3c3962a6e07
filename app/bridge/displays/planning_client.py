"""Plans for displays: approaches that they ask for, and the plan that an arm executes now."""

import threading
from collections.abc import Callable, Mapping

from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from app.bridge.calls.action_client import ActionClient
from app.bridge.message_origin import Origin
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.topics import EXECUTED_PLAN
from app.geometry import MarginGuardError

ALLOWED_S = 20.0
_START_S, _ANSWER_S = 5.0, 120.0


class ApproachRequest:
    """Asks the action ``/marginguard_plan/plan``; nothing moves."""

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._client: ActionClient | None = None

    def plan(
        self, joints: Mapping[str, float], clearance_mm: float, answer: Callable[[str, str], None]
    ) -> Callable[[], None]:
        """Plan to ``joints``; ``answer(plan, problem)`` is called in a thread of its own.

        Returns a function that cancels it.
        """
        cancelled = threading.Event()
        threading.Thread(
            target=lambda: answer(*self._ask(joints, clearance_mm, cancelled)),
            name="approach",
            daemon=True,
        ).start()
        return cancelled.set

    def _ask(
        self, joints: Mapping[str, float], clearance_mm: float, cancelled: threading.Event
    ) -> tuple[str, str]:
        try:
            if self._client is None:
                name = "/marginguard_plan/plan"
                self._client = ActionClient(self._ros, "marginguard_msgs/action/Plan", name)
            goal = self._client.type.Goal(
                joints=list(joints),
                positions=list(joints.values()),
                clearance=clearance_mm / MM_PER_M,
                allowed_time=ALLOWED_S,
            )
            self._client.wait(_START_S, cancelled)
            return self._client.call(goal, _ANSWER_S, cancelled).plan, ""
        except MarginGuardError as error:
            return "", str(error)


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
