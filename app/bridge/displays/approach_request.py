"""Approaches for displays, from the node of ``marginguard plan serve``."""

import threading
from collections.abc import Callable, Mapping

from app.bridge.calls.action_client import ActionClient
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
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
    ) -> None:
        """Plan to ``joints``; ``answer(plan, problem)`` is called in a thread of its own."""
        threading.Thread(
            target=lambda: answer(*self._ask(joints, clearance_mm)), name="approach", daemon=True
        ).start()

    def _ask(self, joints: Mapping[str, float], clearance_mm: float) -> tuple[str, str]:
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
            sent = self._client.start(goal, _START_S)
            return sent.result(_ANSWER_S).plan, ""
        except MarginGuardError as error:
            return "", str(error)
