"""Service ``~/rearm``: an operator ends the hold of an earlier fault or of a change."""

from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.node import RosNode
from app.hold import SeenHold
from app.runtime import OperatorCommands, RequestKind

MAX_WAITING = 1000
"""Requests that wait for the node's thread. The oldest one is dropped for a new one: with ROS's
default of 10 a burst of another node would drop a valid request."""


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
