"""The operator's word that a held robot may move again: ``~/rearm``."""

from collections.abc import Callable

from marginguard_msgs.srv import Rearm

from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request names the constraint (``seq``) that the operator was looking at. It is refused when
    the state became UNKNOWN after that one, which nobody can have looked at, and while the state
    is UNKNOWN: ``rearm`` raises `NotRearmableError` then.
    """

    def __init__(
        self, ros: RosNode, *, rearm: Callable[[], None], fault_seq: Callable[[], int]
    ) -> None:
        self._rearm = rearm
        self._fault_seq = fault_seq
        ros.node.create_service(Rearm, "~/rearm", self._serve)

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> Rearm.Response:
        response.message = self._refusal(request.seq)
        response.success = not response.message
        return response

    def _refusal(self, seq: int) -> str:
        fault_seq = self._fault_seq()
        if seq < fault_seq:
            return f"seq is {seq}: a fault began with constraint {fault_seq}, after it"
        try:
            self._rearm()
        except MarginGuardError as error:
            return str(error)
        return ""
