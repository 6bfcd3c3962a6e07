"""The operator of guard, controller and arm: re-arms what stands, and records their states."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Rearm
from std_srvs.srv import Trigger

from app.bridge.node import RosNode
from app.bridge.topics import NEWEST, STREAM, Topic

ASK_S = 0.3  # time between two requests


class Operator:
    """While `rearming` is set, re-arms guard and controller and enables the arm ``/arm``."""

    def __init__(self, ros: RosNode) -> None:
        self._changed = threading.Condition()
        self._states: dict[str, str] = {}
        self._values: dict[str, dict[str, str]] = {}
        self._constraint: Any = None
        self.rearming = threading.Event()
        self.rearming.set()
        ros.subscribe(Topic("/diagnostics", DiagnosticArray, STREAM), self._take_status)
        ros.subscribe(
            Topic("/marginguard/constraint", FixtureConstraint, NEWEST), self._take_constraint
        )
        self._arm = ros.node.create_client(Trigger, "/arm/enable")
        self._control = ros.node.create_client(Trigger, "/marginguard_control/rearm")
        self._guard = ros.node.create_client(Rearm, "/marginguard/rearm")

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until ``condition``, re-arming meanwhile; False after ``timeout_s``."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            with self._changed:
                if self._changed.wait_for(condition, ASK_S):
                    return True
            self.rearm()
        return False

    def state(self, name: str) -> str:
        """The message of ``marginguard: NAME`` on ``/diagnostics``; empty before the first."""
        return self._states.get(f"marginguard: {name}", "")

    def stops(self) -> Counter[str]:
        """Number of times that the controller stopped an arm that followed the hand, by reason."""
        values = self._values.get("marginguard: control /arm", {})
        found = {key: int(count) for key, count in values.items() if key.startswith("stops: ")}
        return Counter({key.removeprefix("stops: "): count for key, count in found.items()})

    def texts(self) -> dict[str, str]:
        return dict(self._states)

    def rearm(self) -> None:
        """Request what an operator requests who sees that the cause of a stop is gone."""
        constraint = self._constraint
        if not self.rearming.is_set():
            return
        if self.state("arm arm") not in ("", "ENABLED", "PAUSED"):  # FAULT, with its reason
            self._arm.call_async(Trigger.Request())
        if constraint is not None and constraint.hold and constraint.rearm_nonce:
            self._guard.call_async(Rearm.Request(seq=constraint.seq, nonce=constraint.rearm_nonce))
        if self.state("control /arm").startswith("watchdog"):
            self._control.call_async(Trigger.Request())

    def _take_status(self, message: DiagnosticArray) -> None:
        with self._changed:
            for each in message.status:
                self._states[each.name] = each.message
                self._values[each.name] = {pair.key: pair.value for pair in each.values}
            self._changed.notify_all()

    def _take_constraint(self, message: FixtureConstraint) -> None:
        self._constraint = message
