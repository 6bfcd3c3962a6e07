"""The operator's word that a held robot may move again: ``~/rearm``."""

from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.constraint_stream import ConstraintStream
from app.bridge.control.session_changes import BetweenSteps
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request names the constraint (``seq``) that the operator was looking at. It is refused when
    the state became UNKNOWN after that one, which nobody can have looked at, while ``constraints``
    repeats a stale one, and while the state is UNKNOWN. All of that is looked at between two steps,
    so that no fault and no other tumour comes in between. It is answered from a thread of its own,
    because samples have to be heard while it waits for a step.
    """

    def __init__(
        self, ros: RosNode, constraints: ConstraintStream, between_steps: BetweenSteps
    ) -> None:
        self._constraints = constraints
        self._between_steps = between_steps
        ServiceServer(ros, Rearm, "~/rearm", self._serve, in_thread=True)

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> None:
        with self._between_steps() as session:
            fault_seq = self._constraints.fault_seq
            if request.seq < fault_seq:
                raise BridgeError(
                    f"seq is {request.seq}: a fault began with constraint {fault_seq}, after it"
                )
            if self._constraints.ended:
                raise BridgeError("the constraint is stale: its cause must end before re-arming")
            session.rearm()
        response.success = True
