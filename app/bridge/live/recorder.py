"""Topics of the ROS graph into a bag, as raw bytes with the times of sending and of receipt."""

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.case import BagTopic, BagWriter, message_definition
from app.geometry import NS_PER_S, InputError, MarginGuardError

_DEPTH = 1000
_MOST_REMEMBERED = 10_000
_INFINITE_NS = 2**63 - 1


class RosRecorder:
    """Records those of ``topics`` (full names) that appear; their types are asked of the graph.

    Call `discover` and `flush` now and then: what was not flushed is lost when the process is
    killed. Messages are written as they arrive, in the node's thread. What cannot be recorded is
    in `refused`, by topic. An error of the bag is raised by the next `flush`, and nothing is
    written after it.

    Each publisher is heard as reliably as it promises, also one that joins later with a weaker
    promise: a topic has a subscription for each promise, and what comes by two is written once.
    """

    def __init__(self, ros: RosNode, bag: BagWriter, topics: Sequence[str]) -> None:
        self._ros = ros
        self._bag = bag
        self._wanted = list(dict.fromkeys(topics))
        self._recorded: dict[str, _Recorded] = {}
        self._lock = threading.Lock()
        self._error: MarginGuardError | None = None
        self.refused: dict[str, str] = {}

    def discover(self) -> list[str]:
        """Begin to record the topics that have a publisher by now; returns those that are new."""
        types = dict(self._ros.node.get_topic_names_and_types())
        begun = []
        for name in list(self._wanted):
            publishers = self._ros.node.get_publishers_info_by_topic(name)
            if name not in types or not publishers:
                continue
            self._wanted.remove(name)
            try:
                self._begin(name, publishers)
            except MarginGuardError as error:
                self.refused[name] = str(error)
            else:
                begun.append(name)
        for name, recorded in self._recorded.items():
            self._hear(recorded, self._ros.node.get_publishers_info_by_topic(name))
        return begun

    def want(self, topic: str) -> None:
        """Record this topic too, once it appears."""
        if topic not in self._wanted and topic not in self._recorded:
            self._wanted.append(topic)

    def last(self, topic: str) -> tuple[int, bytes] | None:
        """When the newest message of ``topic`` came, in ns since 1970, and its bytes."""
        recorded = self._recorded.get(topic)
        return None if recorded is None else recorded.last

    def flush(self) -> None:
        """Hand what has arrived to the operating system; raises what went wrong since."""
        with self._lock:
            if self._error is not None:
                raise self._error
            self._bag.flush()

    def _begin(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        kinds = {info.topic_type for info in publishers}
        if len(kinds) > 1:
            raise InputError(f"{name} has several types: {', '.join(sorted(kinds))}")
        (kind,) = kinds
        topic = BagTopic(
            name,
            kind,
            message_definition(kind, ros_prefixes()),
            tuple(_offered(info.qos_profile) for info in publishers),
            str(publishers[0].topic_type_hash),
        )
        recorded = _Recorded(name, _message_class(kind), self._write)
        with self._lock:
            self._bag.add_topic(topic)
        self._recorded[name] = recorded
        self._hear(recorded, publishers)

    def _hear(self, recorded: "_Recorded", publishers: Sequence[TopicEndpointInfo]) -> None:
        for info in publishers:
            promise = (info.qos_profile.reliability, info.qos_profile.durability)
            if promise in recorded.promises:
                continue
            recorded.promises.add(promise)
            heard = Topic(recorded.name, recorded.message_class, _as_promised(*promise))
            # rclpy hands the times to a callback of two arguments.
            self._ros.subscribe(heard, recorded.take, raw=True)  # type: ignore[arg-type]

    def _write(self, name: str, data: bytes, received_ns: int, published_ns: int) -> None:
        with self._lock:
            if self._error is not None:
                return
            try:
                self._bag.write(name, data, received_ns=received_ns, published_ns=published_ns)
            except MarginGuardError as error:
                self._error = error


class _Recorded:
    """A topic that is recorded: the promises that it is heard by, and what came a moment ago."""

    def __init__(
        self, name: str, message_class: type, write: Callable[[str, bytes, int, int], None]
    ) -> None:
        self.name = name
        self.message_class = message_class
        self.promises: set[tuple[ReliabilityPolicy, DurabilityPolicy]] = set()
        self.last: tuple[int, bytes] | None = None
        self._write = write
        self._seen: set[tuple[int, int, int]] = set()
        self._in_order: deque[tuple[int, int, int]] = deque()

    def take(self, data: bytes, info: Mapping[str, int]) -> None:
        """Write a message, unless it has come by another subscription already."""
        key = (info["source_timestamp"], info["publication_sequence_number"], hash(data))
        if key in self._seen:
            return
        self._seen.add(key)
        self._in_order.append(key)
        if len(self._in_order) > _MOST_REMEMBERED:
            self._seen.remove(self._in_order.popleft())
        received_ns = info["received_timestamp"] or time.time_ns()
        self.last = received_ns, data
        self._write(self.name, data, received_ns, info["source_timestamp"] or received_ns)


def ros_prefixes() -> tuple[Path, ...]:
    """Where ROS packages are installed: an installation's prefixes, and this Python's."""
    named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return (*(Path(prefix) for prefix in named if prefix), Path(sys.prefix))


def _message_class(kind: str) -> type:
    package, _, name = kind.split("/")
    try:
        found: type = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise BridgeError(f"message type {kind} cannot be imported: {error}") from error
    return found


def _as_promised(reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_DEPTH,
        reliability=reliability,
        durability=durability,
    )


def _offered(profile: QoSProfile) -> dict[str, Any]:
    """A publisher's promise in the words of rosbag2."""
    return {
        "history": HistoryPolicy(profile.history).name.lower(),
        "depth": profile.depth,
        "reliability": ReliabilityPolicy(profile.reliability).name.lower(),
        "durability": DurabilityPolicy(profile.durability).name.lower(),
        "deadline": _duration(profile.deadline.nanoseconds),
        "lifespan": _duration(profile.lifespan.nanoseconds),
        "liveliness": LivelinessPolicy(profile.liveliness).name.lower(),
        "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
        "avoid_ros_namespace_conventions": bool(profile.avoid_ros_namespace_conventions),
    }


def _duration(ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(min(ns, _INFINITE_NS), NS_PER_S)
    return {"sec": seconds, "nsec": nanoseconds}
