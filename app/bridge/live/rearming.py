"""Service ``~/rearm``: an operator ends the hold of an earlier fault or of a change."""

from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.runtime import OperatorCommands, RearmRefusedError, RequestKind, SeenHold
from app.runtime.holds import check_nonce

MAX_WAITING = 1000
"""Requests that wait for the node's thread. The oldest one is dropped for a new one: with ROS's
default of 10 a burst of another node would drop a valid request."""


class StreamHolds:
    """`app.runtime.Holds` of the constraints that ``constraints`` publishes."""

    def __init__(self, constraints: ConstraintStream) -> None:
        self._constraints = constraints

    def present(self) -> SeenHold:
        """The hold of the last constraint."""
        return SeenHold(max(0, self._constraints.seq - 1), self._constraints.rearm_nonce)

    def check(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` unless ``seen`` is the present hold.

        Also refused: a constraint before the last fault, one that was not published yet, and any
        while a stale constraint is repeated.
        """
        fault_seq = self._constraints.fault_seq
        if seen.seq < fault_seq:
            raise RearmRefusedError(
                f"seq is {seen.seq}: a fault began with constraint {fault_seq}, after it; expected "
                f"the seq of a constraint from {fault_seq} on"
            )
        if seen.seq >= self._constraints.seq:
            raise RearmRefusedError(
                f"seq is {seen.seq}: not published yet; expected at most "
                f"{self._constraints.seq - 1}"
            )
        if self._constraints.ended:
            raise RearmRefusedError("the constraint is stale: its cause must end before re-arming")
        check_nonce(seen.nonce, self._constraints.rearm_nonce)

    def spend(self, seen: SeenHold) -> None:
        """End the validity of the nonce."""
        self._constraints.spend(seen.nonce)


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request contains the ``seq`` and the ``rearm_nonce`` of the constraint that the operator was
    looking at; `OperatorCommands.rearm` checks them between two steps. It runs in its own thread,
    because samples must be received while it waits for a step. A request that is invalid at once
    is refused without a thread, so that a flood of them does not occupy it.
    """

    def __init__(
        self, ros: RosNode, commands: OperatorCommands, requests: OperatorRequests
    ) -> None:
        self._commands = commands
        self._requests = requests
        ServiceServer(
            ros,
            Rearm,
            "~/rearm",
            self._serve,
            in_thread=True,
            check=self._check,
            max_waiting=MAX_WAITING,
            # A misread request has no valid nonce, and another client must not prevent a valid one.
            any_definition=True,
        )

    def _check(self, request: Rearm.Request) -> None:
        with self._requests.refusals(RequestKind.REARM):
            self._commands.check_rearm(SeenHold(request.seq, request.nonce))
            self._requests.check(RequestKind.REARM, "~/rearm")

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> None:
        self._commands.rearm(SeenHold(request.seq, request.nonce), origin=OVER_ROS)
        response.success = True
