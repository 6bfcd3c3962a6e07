"""Start of a live session as the only guard: no other one runs, and the last hold is kept."""

import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from marginguard_msgs.msg import FixtureConstraint
from rclpy.logging import get_logger
from std_msgs.msg import Empty

from app.bridge.environment import domain_of
from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.sender_names import node_name
from app.bridge.topics import NEWEST, Topic
from app.files.paths import state_folder
from app.fixture import Reason
from app.hold import InstanceKey, LiveState, arm_name, host_id, live_state
from app.runtime import PreparedLive, used_values
from app.session.session import NOTHING_OUTSIDE

MIN_DISCOVERY_S = 0.5
MAX_DISCOVERY_S = 4.0
"""Limits of the time in which a guard on this machine is found: 0.1 to 0.3 s on an idle one. Later
ones are found while the session runs."""

_FACTOR = 3.0
"""A probe of this process is found first; others may take this much longer."""

SILENCE_S = 1.0
"""Time in which a guard that runs repeats its constraint."""

LEASE_S = 25.0
"""Time after which the middleware forgets a process that was killed: 20 s with Fast DDS."""

NAME_S = 1.0
"""Time in which the name of a node follows its first endpoint."""

_POLL_S = 0.02
_CHECK_S = 0.2


@dataclass(slots=True)
class SilentPublishers:
    """Publishers of ``topic`` that were there before this guard, by their ``gids``.

    As long as one is left, `faults` keeps the session on hold.
    """

    topic: str
    gids: frozenset[bytes]
    _began_s: float = field(default_factory=time.monotonic)
    _checked_s: float = 0.0

    def faults(self, ros: RosNode) -> Mapping[Reason, str]:
        """The fault that there is another publisher; empty when all have gone.

        Raises `BridgeError` if one is left although the middleware would have forgotten a dead one.
        """
        if not self.gids:
            return NOTHING_OUTSIDE
        now_s = time.monotonic()
        # This node knows all others after some time.
        if now_s - max(self._checked_s, self._began_s) > _CHECK_S and ros.is_open:
            self._checked_s = now_s
            if now_s - self._began_s > SILENCE_S:
                self.gids &= _publishers(ros, self.topic)
        if not self.gids:
            return NOTHING_OUTSIDE
        if now_s - self._began_s > LEASE_S:
            raise BridgeError(
                f"{self.topic}: {_nodes(ros, self.topic, self.gids)} still has a publisher of the "
                f"constraint after {LEASE_S:g} s; expected one guard in this ROS domain and "
                "namespace: end the other one first, or use --namespace"
            )
        return {
            Reason.SECOND_SENDER: "another guard is known on this topic and sends nothing: waiting "
            f"up to {LEASE_S:g} s until the middleware has forgotten it"
        }


@dataclass(frozen=True, slots=True)
class SingleInstance:
    """The kept ``state`` of a session, and the ``silent`` publishers that were there before it."""

    state: LiveState
    silent: SilentPublishers

    def faults(self, ros: RosNode) -> Mapping[Reason, str]:
        """Faults of the session outside its samples: another guard may have its place.

        Raises `BridgeError` for one that has not gone after the lease of the middleware.
        """
        if self.state.problem:
            return {Reason.SECOND_SENDER: self.state.problem}
        return self.silent.faults(ros)


@contextmanager
def single_instance(
    prepared: PreparedLive, name: str, namespace: str, ros: RosNode | None
) -> Iterator[SingleInstance]:
    """Make sure that this is the only guard; keep its hold and values on disk within the context.

    ``name`` is that of the node. Raises `SecondInstanceError` or `BridgeError` beside another
    guard, and `StateFileError` if a hold could not be kept for the next run.
    """
    logger = get_logger(name)
    domain_id = domain_of() if ros is None else ros.node.context.get_domain_id()
    key = _key(prepared, domain_id, namespace if ros is None else ros.node.get_namespace())
    used = used_values(prepared.content)
    with live_state(state_folder(), key, used, clock_ns=time.time_ns, log=logger.error) as state:
        silent = find_silent_publishers(name, key.namespace, domain_id)
        for cause in state.start_causes:
            logger.warning(f"HOLD: {cause}")
        yield SingleInstance(state, silent)


def find_silent_publishers(name: str, namespace: str, domain_id: int | None) -> SilentPublishers:
    """Look for publishers of the constraint of the node ``name`` in ``namespace``.

    Uses a node of its own for 0.5 to 4 s, so that a refused guard does not appear on the graph
    under the guard's name. Raises `BridgeError` for a publisher that sends: another guard, or a
    replay. Returns publishers that send nothing: of a process that was killed and is not forgotten
    yet, or of an inactive one.
    """
    received = threading.Event()
    began_s = time.monotonic()
    with RosNode(f"{name}_start", namespace=namespace, domain_id=domain_id) as ros:
        topic = Topic(f"{name}/constraint", FixtureConstraint, NEWEST)
        subscription = ros.subscribe(topic, lambda _: received.set(), raw=True)
        resolved = str(subscription.topic_name)
        ends_s = began_s + _discovery_s(ros, namespace, domain_id, received)
        found: frozenset[bytes] = frozenset()
        while not received.is_set() and time.monotonic() < ends_s:
            if not found and (found := _publishers(ros, resolved)):
                ends_s = time.monotonic() + SILENCE_S
            received.wait(_POLL_S)
        found |= _publishers(ros, resolved)
        ends_s = time.monotonic() + NAME_S
        while received.is_set() and not _names(ros, resolved) and time.monotonic() < ends_s:
            time.sleep(_POLL_S)
        if received.is_set() or ros.definition_problems:
            raise BridgeError(
                f"{resolved}: {_nodes(ros, resolved)} publishes the constraint already; expected "
                "one guard, and no replay, in this ROS domain and namespace: end the other one "
                "first, or use --namespace"
            )
    return SilentPublishers(resolved, found)


def _discovery_s(
    ros: RosNode, namespace: str, domain_id: int | None, received: threading.Event
) -> float:
    """Seconds that ``ros`` needs to find others: a busy machine takes longer to find a probe, too.

    Returns early when a constraint has been ``received``.
    """
    began_s = time.monotonic()
    probed = Topic(f"{ros.node.get_name()}/probe_{os.getpid()}", Empty, NEWEST)
    with RosNode(f"{ros.node.get_name()}_probe", namespace=namespace, domain_id=domain_id) as probe:
        topic = probe.publisher(probed).topic_name
        while not ros.node.count_publishers(topic) and not received.wait(_POLL_S):
            if time.monotonic() - began_s > MAX_DISCOVERY_S:
                break
    took_s = time.monotonic() - began_s
    return min(max(MIN_DISCOVERY_S, _FACTOR * took_s), MAX_DISCOVERY_S)


def _key(prepared: PreparedLive, domain_id: int, namespace: str) -> InstanceKey:
    robot, entry = prepared.setup.robot, prepared.case.manifest.robot
    arm = ""
    if robot is not None:
        arm = arm_name(robot.robot.name, None if entry is None else entry.joint_states)
    return InstanceKey(host_id(), domain_id, f"/{namespace.strip('/')}", arm)


def _publishers(ros: RosNode, topic: str) -> frozenset[bytes]:
    found = ros.node.get_publishers_info_by_topic(topic)
    return frozenset(bytes(info.endpoint_gid) for info in found)


def _nodes(ros: RosNode, topic: str, gids: frozenset[bytes] | None = None) -> str:
    return ", ".join(_names(ros, topic, gids)) or "another node"


def _names(ros: RosNode, topic: str, gids: frozenset[bytes] | None = None) -> list[str]:
    """The known names of the nodes that publish ``topic``."""
    return sorted(
        {
            f"node {node_name(info)}"
            for info in ros.node.get_publishers_info_by_topic(topic)
            if info.node_name != UNKNOWN_NODE and (gids is None or bytes(info.endpoint_gid) in gids)
        }
    )
