"""Requests over ROS to change a session: who may send them, and margins as parameters.

Times are in milliseconds, as in `case.yaml`; the core uses nanoseconds.
"""

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager

from rclpy.node import Node, NodeNameNonExistentError
from rclpy.parameter import Parameter

from app.bridge.calls.parameter_server import ParameterDeclaration, ParameterServer, Plain
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.case.manifest.key_rules import MARGINS
from app.fixture import MarginParameterError, MarginParameters
from app.geometry import NS_PER_MS, MarginGuardError
from app.hold import loosened_margins
from app.runtime import OperatorRequest, RequestKind, RequestLog

OVER_ROS = "ROS"
"""Origin of a request of another process."""


MAX_NAMED = 5
"""Nodes that a message names."""


class OperatorError(BridgeError):
    """A node that is no listed operator could have sent the request."""


class OperatorList:
    """Checks requests against ``allowed``, full names of nodes; None accepts every node.

    A guard against mistakes, not against attackers. ROS does not tell a service which node has sent
    a request, but the graph tells which nodes have a client of the service. So a request is
    accepted only while no other node than the listed ones has one. A node may choose any name, and
    a DDS program needs no node at all: against those only ROS security helps
    (`docs/security_ros.md`).
    """

    def __init__(self, ros: RosNode, allowed: Iterable[str] | None) -> None:
        self._node: Node = ros.node
        self._allowed = None if allowed is None else frozenset(allowed)

    def check(self, *services: str) -> None:
        """Raise `OperatorError` if a node that is not listed has a client of one of ``services``.

        Names may be relative (``~/rearm``). A node that is still being discovered is not known.
        """
        if self._allowed is None:
            return
        names = {self._node.resolve_service_name(service) for service in services}
        others = sorted(self._clients(names) - self._allowed)
        if others:
            more = f" and {len(others) - MAX_NAMED} more" if len(others) > MAX_NAMED else ""
            raise OperatorError(
                f"{', '.join(sorted(names))}: the node {', '.join(others[:MAX_NAMED])}{more} has a "
                f"client and is no operator; expected clients of "
                f"{', '.join(sorted(self._allowed))} alone (operators in live.yaml)"
            )

    def _clients(self, services: set[str]) -> set[str]:
        """Full names of the other nodes that have a client of one of ``services``."""
        own = self._node.get_fully_qualified_name()
        found = set()
        for name, namespace in self._node.get_node_names_and_namespaces():
            full = f"{namespace.rstrip('/')}/{name}"
            if full == own:
                continue
            try:
                clients = self._node.get_client_names_and_types_by_node(name, namespace)
            except NodeNameNonExistentError:  # it has left
                continue
            if any(service in services for service, _ in clients):
                found.add(full)
        return found


class OperatorRequests:
    """Checks requests of other processes and lists those that are refused before their command.

    ``operators`` are the nodes of ``live.yaml``. Every listed request is logged by the node.
    """

    def __init__(self, ros: RosNode, log: RequestLog, operators: OperatorList) -> None:
        self._ros = ros
        self._log = log
        self._operators = operators
        log.listen(self._print)

    def check(self, kind: str, *services: str) -> None:
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
    def refusals(self, kind: str, origin: str = OVER_ROS) -> Iterator[None]:
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


class MarginParameterServer:
    """Declares each margin on ``ros`` with unit and range, and applies every valid set.

    ``use(margins, origin)`` is called with each set that differs from the previous one: in the
    node's thread for a request over ROS, in the caller's for `set`; on construction if
    ``--ros-args -p`` overrides ``margins``. A `MarginGuardError` raised by
    it refuses the set. The constructor raises `CallError` if the initial values are refused.

    `margins` are the requested ones: looser values apply from the next re-arm on.
    ``on_refusal(reason, origin)`` is called for each set that is refused before ``use``.
    """

    def __init__(
        self,
        ros: RosNode,
        margins: MarginParameters,
        use: Callable[[MarginParameters, str], None],
        on_refusal: Callable[[str, str], None] = lambda reason, origin: None,
    ) -> None:
        self.margins = margins
        self._ros = ros
        self._use = use
        self._on_refusal = on_refusal
        self._used = False
        self._setting = threading.Lock()
        self._setter: int | None = None
        self._set_by = OVER_ROS
        self._server = ParameterServer(
            ros, _declarations(margins), self._accept, on_refusal=self._refused
        )

    def close(self) -> None:
        """Undeclare the parameters."""
        self._server.close()

    def set(self, *, origin: str, **changes: float) -> None:
        """Set margins from this process, atomically, as a ROS request does, listed as ``origin``.

        Raises `MarginParameterError` with the reason if the set is refused.
        """
        parameters = [Parameter(name, value=value) for name, value in changes.items()]
        with self._setting:
            self._setter, self._set_by = threading.get_ident(), origin
            try:
                result = self._ros.node.set_parameters_atomically(parameters)
            finally:
                self._setter = None
        if not result.successful:
            raise MarginParameterError(result.reason)

    def _accept(self, values: Mapping[str, Plain]) -> None:
        self._used = False
        margins = margins_of(values)
        if margins != self.margins:
            self._used = True
            self._use(margins, self._origin())
            self.margins = margins

    def _refused(self, reason: str) -> None:
        used, self._used = self._used, False
        if not used:  # `use` reports its own refusals
            self._on_refusal(reason, self._origin())

    def _origin(self) -> str:
        """Who sets in this thread."""
        return self._set_by if self._setter == threading.get_ident() else OVER_ROS


def margins_of(values: Mapping[str, Plain]) -> MarginParameters:
    """Convert parameter values to margins; raises `MarginParameterError`."""
    found = {}
    for name in MarginParameters.ranges():
        ros_name = _ros_name(name)
        value = values.get(ros_name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MarginParameterError(f"{ros_name} is {value!r}; expected a number")
        found[name] = round(value * NS_PER_MS) if ros_name != name else value
    return MarginParameters(**found)  # type: ignore[arg-type]


def _declarations(margins: MarginParameters) -> list[ParameterDeclaration]:
    found = []
    for name, (lowest, highest, unit) in MarginParameters.ranges().items():
        value = getattr(margins, name)
        is_integer = unit == "samples"
        if unit == "ns":
            value, unit = value / NS_PER_MS, "ms"
            lowest, highest = lowest / NS_PER_MS, highest / NS_PER_MS
        found.append(
            ParameterDeclaration(
                name=_ros_name(name),
                value=int(value) if is_integer else float(value),
                text=MARGINS.keys[_ros_name(name)].description,
                unit=unit,
                lowest=lowest,
                highest=highest,
            )
        )
    return found


def _ros_name(name: str) -> str:
    """Name of the parameter, with ``_ms`` instead of ``_ns``."""
    return name.removesuffix("_ns") + "_ms" if name.endswith("_ns") else name
