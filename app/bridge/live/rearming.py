"""Service ``~/rearm``: an operator ends the hold of an earlier fault."""

from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_server import ServiceServer
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.runtime import OperatorCommands


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request contains the ``seq`` of the constraint that the operator was looking at. It is refused
    when the state became UNKNOWN after that constraint, while ``constraints`` repeats a stale one,
    and while the state is UNKNOWN. All of this is checked between two steps, so that no fault and
    no other tumour can come in between. The service runs in its own thread, because samples must
    be received while it waits for a step.
    """

    def __init__(
        self, ros: RosNode, constraints: ConstraintStream, commands: OperatorCommands
    ) -> None:
        self._constraints = constraints
        self._commands = commands
        ServiceServer(ros, Rearm, "~/rearm", self._serve, in_thread=True)

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> None:
        self._commands.rearm(lambda: self._check(request.seq))
        response.success = True

    def _check(self, seq: int) -> None:
        fault_seq = self._constraints.fault_seq
        if seq < fault_seq:
            raise BridgeError(
                f"seq is {seq}: a fault began with constraint {fault_seq}, after it; expected the "
                f"seq of a constraint from {fault_seq} on"
            )
        if self._constraints.ended:
            raise BridgeError("the constraint is stale: its cause must end before re-arming")
