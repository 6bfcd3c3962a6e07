"""Client of ``~/rearm``: the hold of a guard on the graph, and the request to end it."""

from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Rearm

from app.bridge.calls.service_client import ServiceClient
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.qos import NEWEST, Topic
from app.runtime import LatestValue


class RearmClient:
    """Reads the constraints of the guard ``name`` (a node in the namespace of ``ros``)."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._ros = ros
        self._latest: LatestValue[FixtureConstraint] = LatestValue()
        self._service = ServiceClient(ros, Rearm, f"{name}/rearm")
        topic = Topic(f"{name}/constraint", FixtureConstraint, NEWEST)
        self.topic = str(ros.subscribe(topic, self._latest.put).topic_name)

    def constraint(self, timeout_s: float) -> FixtureConstraint:
        """Wait for the next constraint, not one that has arrived before the call.

        Raises `BridgeError` if none arrives or several guards send.
        """
        self._latest.take(0.0)
        found = self._latest.take(timeout_s)
        problems = self._ros.definition_problems
        if problems:
            raise BridgeError(problems[0])
        if found is None:
            raise BridgeError(
                f"{self.topic}: no constraint within {timeout_s:g} s; expected a running guard "
                "('marginguard live') in this ROS domain and namespace"
            )
        self._check_single()
        return found

    def rearm(self, seen: FixtureConstraint, timeout_s: float) -> Rearm.Response:
        """Request the end of the hold that the operator saw. Raises `CallError`.

        Raises `BridgeError` and sends nothing if several guards are known by now: one could re-arm
        and another refuse. The request is sent once, because its nonce is valid once.
        """
        self._check_single()
        return self._service.call(Rearm.Request(seq=seen.seq, nonce=seen.rearm_nonce), timeout_s)

    def _check_single(self) -> None:
        publishers = self._ros.node.count_publishers(self.topic)
        if publishers > 1:
            raise BridgeError(f"{self.topic}: {publishers} publishers; expected a single guard")
