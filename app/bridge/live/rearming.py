"""Service ``~/rearm``: an operator ends the hold of an earlier fault."""

from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_server import ServiceServer
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.runtime import OperatorCommands


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request contains the ``seq`` and the ``rearm_nonce`` of the constraint that the operator was
    looking at. It is refused when the state became UNKNOWN after that constraint, while
    ``constraints`` repeats a stale one, while the state is UNKNOWN, and with another nonce than
    that of the present hold. A nonce re-arms once. All of this is checked between two steps, so
    that no fault and no other tumour can come in between. The service runs in its own thread,
    because samples must be received while it waits for a step.
    """

    def __init__(
        self, ros: RosNode, constraints: ConstraintStream, commands: OperatorCommands
    ) -> None:
        self._constraints = constraints
        self._commands = commands
        ServiceServer(ros, Rearm, "~/rearm", self._serve, in_thread=True)

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> None:
        self._commands.rearm(lambda: self._check(request.seq, request.nonce))
        self._constraints.spend(request.nonce)
        response.success = True

    def _check(self, seq: int, nonce: int) -> None:
        fault_seq = self._constraints.fault_seq
        if seq < fault_seq:
            raise BridgeError(
                f"seq is {seq}: a fault began with constraint {fault_seq}, after it; expected the "
                f"seq of a constraint from {fault_seq} on"
            )
        if seq >= self._constraints.seq:
            raise BridgeError(
                f"seq is {seq}: not published yet; expected at most {self._constraints.seq - 1}"
            )
        if self._constraints.ended:
            raise BridgeError("the constraint is stale: its cause must end before re-arming")
        present = self._constraints.rearm_nonce
        if present == 0:
            raise BridgeError("no hold is latched; expected a constraint with the reason 'latched'")
        if nonce != present:
            raise BridgeError(
                f"nonce is {nonce}: not that of the present hold; expected the rearm_nonce of its "
                "constraint"
            )
