"""Requests over ROS to change a session: who may send them, how many, and what is listed."""

from collections.abc import Iterator
from contextlib import contextmanager

from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operators import OperatorList
from app.bridge.node import RosNode
from app.fixture import MarginParameters
from app.geometry import MarginGuardError
from app.hold import loosened_margins
from app.runtime import OperatorRequest, RequestKind, RequestLog


class OperatorRequests:
    """Checks requests of other processes and lists those that are refused before their command.

    ``operators`` are the nodes of ``live.yaml``. Every listed request is logged by the node.
    """

    def __init__(self, ros: RosNode, log: RequestLog, operators: OperatorList) -> None:
        self._ros = ros
        self._log = log
        self._operators = operators
        log.listen(self._print)

    def check(self, kind: RequestKind, *services: str) -> None:
        """Raise `MarginGuardError` for too many requests, or a client that is no operator."""
        self._log.admit(kind)
        self._operators.check(*services)

    def check_margins(
        self, in_use: MarginParameters, requested: MarginParameters, *services: str
    ) -> None:
        """Check a set of margins. What only tightens is not limited in rate."""
        if loosened_margins(in_use, requested, follows_tumor=True):
            self._log.admit(RequestKind.MARGINS)
        self._operators.check(*services)

    @contextmanager
    def refusals(self, kind: RequestKind, origin: str = OVER_ROS) -> Iterator[None]:
        """List a request that is refused within the context. Not around a command, which lists."""
        try:
            yield
        except MarginGuardError as error:
            self._log.refused(kind, origin, str(error))
            raise

    def _print(self, request: OperatorRequest) -> None:
        # Two calls: rclpy remembers the severity of each place in the source.
        if request.accepted:
            self._ros.node.get_logger().info(request.line)
        else:
            self._ros.node.get_logger().warning(request.line)
