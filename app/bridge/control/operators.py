"""The list of operator nodes of ``live.yaml``: a guard against mistakes, not against attackers.

ROS does not tell a service which node has sent a request. What the graph tells is which nodes have
a client of the service. So a request is accepted only while no other node than the listed ones has
one. A node may choose any name, and a DDS program needs no node at all: against those only ROS
security helps (`docs/security_ros.md`).
"""

from collections.abc import Iterable

from rclpy.node import Node, NodeNameNonExistentError

from app.bridge.errors import BridgeError
from app.bridge.node import RosNode

MAX_NAMED = 5
"""Nodes that a message names."""


class OperatorError(BridgeError):
    """A node that is no listed operator could have sent the request."""


class OperatorList:
    """Checks requests against ``allowed``, full names of nodes; None accepts every node."""

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
