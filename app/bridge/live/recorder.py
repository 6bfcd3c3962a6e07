"""Record ROS topics to a bag, as serialised messages with times of sending and of receipt."""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.bag_topics import offered, ros_prefixes
from app.bridge.errors import BridgeError
from app.bridge.message_definitions import are_named, foreign_endpoints
from app.bridge.node import RosNode
from app.bridge.qos import Topic
from app.case import BagTopic, BagWriter, message_definition
from app.geometry import InputError, MarginGuardError

_DEPTH = 1000
_MAX_AT_ONCE = 50
"""Messages of a topic that are taken in one turn of the executor; other topics come next."""

_MAX_REMEMBERED = 10_000


class RosRecorder:
    """Records ``topics`` (full names) as they appear, with the types found on the graph.

    Call `discover`, `flush` and `sync` periodically, from any threads; a killed process loses
    messages since the last `flush`. Messages are written in the node's thread. `refused` maps each
    topic that cannot be recorded to the reason. An error of the bag is raised by every later
    `flush` and `sync`; nothing is written after it.

    Each publisher is recorded with the reliability it offers, also one that joins later with a
    weaker policy. A topic has a subscription for each combination of policies, and a message that
    arrives twice is written once.
    """

    def __init__(self, ros: RosNode, bag: BagWriter, topics: Sequence[str]) -> None:
        self._ros = ros
        self._bag = bag
        self._pending_topics = list(dict.fromkeys(topics))
        self._recorded: dict[str, _Recorded] = {}
        self._lock = threading.Lock()
        self._error: MarginGuardError | None = None
        self.refused: dict[str, str] = {}

    def discover(self) -> list[str]:
        """Start to record topics that have a publisher; returns the newly recorded ones."""
        types = dict(self._ros.node.get_topic_names_and_types())
        started = []
        for name in list(self._pending_topics):
            publishers = self._ros.node.get_publishers_info_by_topic(name)
            if name not in types or not publishers or not _are_named(publishers):
                continue
            self._pending_topics.remove(name)
            try:
                self._start_topic(name, publishers)
            except MarginGuardError as error:
                self.refused[name] = str(error)
            else:
                started.append(name)
        for name, recorded in self._recorded.items():
            self._subscribe(recorded, self._ros.node.get_publishers_info_by_topic(name))
        return started

    def add(self, topic: str) -> None:
        """Record ``topic`` as well once it appears."""
        if topic not in self._pending_topics and topic not in self._recorded:
            self._pending_topics.append(topic)

    def last(self, topic: str) -> tuple[int, bytes] | None:
        """Time of receipt (ns since 1970) and bytes of the latest message; None before it."""
        recorded = self._recorded.get(topic)
        return None if recorded is None else recorded.last

    def flush(self) -> None:
        """Write buffered messages to the operating system; raises an earlier error of the bag."""
        with self._lock:
            self._guarded(self._bag.flush)

    def sync(self) -> None:
        """Write flushed messages to the disk; raises an earlier error of the bag."""
        self._guarded(self._bag.sync)  # without the lock: the disk may take long

    def _guarded(self, act: Callable[[], None]) -> None:
        if self._error is None:
            try:
                act()
            except MarginGuardError as error:
                self._error = self._error or error
        if self._error is not None:
            raise self._error

    def _start_topic(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        kinds = {info.topic_type for info in publishers}
        if len(kinds) > 1:
            raise InputError(
                f"{name} has the types {', '.join(sorted(kinds))}; expected a single type"
            )
        (kind,) = kinds
        message_class = _message_class(kind)
        foreign = foreign_endpoints(publishers, message_class)
        if foreign:
            raise InputError(
                f"{', '.join(sorted(foreign))} has another definition of {kind}; expected the "
                "marginguard_msgs of this installation on both sides"
            )
        topic = BagTopic(
            name,
            kind,
            message_definition(kind, ros_prefixes()),
            tuple(offered(info.qos_profile) for info in publishers),
            str(publishers[0].topic_type_hash),
        )
        recorded = _Recorded(name, message_class, self._write)
        with self._lock:
            self._bag.add_topic(topic)
        self._recorded[name] = recorded
        self._subscribe(recorded, publishers)

    def _subscribe(self, recorded: "_Recorded", publishers: Sequence[TopicEndpointInfo]) -> None:
        for info in publishers:
            policies = (info.qos_profile.reliability, info.qos_profile.durability)
            if policies in recorded.qos_policies:
                continue
            recorded.qos_policies.add(policies)
            topic = Topic(recorded.name, recorded.message_class, _matching_qos(*policies))
            subscriptions: list[Subscription] = []  # empty while the callback may already be called
            take_all = partial(recorded.take_all, subscriptions)
            # rclpy passes the times to a callback with two parameters.
            subscription = self._ros.subscribe(topic, take_all, raw=True)
            subscriptions.append(subscription)

    def _write(self, name: str, data: bytes, received_ns: int, published_ns: int) -> None:
        with self._lock:
            if self._error is not None:
                return
            try:
                self._bag.write(name, data, received_ns=received_ns, published_ns=published_ns)
            except MarginGuardError as error:
                self._error = error


class _Recorded:
    """State of a recorded topic: the policies it is subscribed with and its latest messages."""

    def __init__(
        self, name: str, message_class: type, write: Callable[[str, bytes, int, int], None]
    ) -> None:
        self.name = name
        self.message_class = message_class
        self.qos_policies: set[tuple[ReliabilityPolicy, DurabilityPolicy]] = set()
        self.last: tuple[int, bytes] | None = None
        self._write = write
        self._seen: set[tuple[int, int, int]] = set()
        self._in_order: deque[tuple[int, int, int]] = deque()

    def take_all(
        self, subscriptions: Sequence[Subscription], data: bytes, info: Mapping[str, int]
    ) -> None:
        """Write a message and those that wait behind it.

        The executor takes one message per turn, and a turn takes longer than a message.
        """
        self.take(data, info)
        for subscription in subscriptions:
            for _ in range(_MAX_AT_ONCE):
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    return
                self.take(*taken)

    def take(self, data: bytes, info: Mapping[str, int]) -> None:
        """Write a message unless it has already arrived by another subscription."""
        key = (info["source_timestamp"], info["publication_sequence_number"], hash(data))
        if key in self._seen:
            return
        self._seen.add(key)
        self._in_order.append(key)
        if len(self._in_order) > _MAX_REMEMBERED:
            self._seen.remove(self._in_order.popleft())
        received_ns = info["received_timestamp"] or time.time_ns()
        self.last = received_ns, data
        self._write(self.name, data, received_ns, info["source_timestamp"] or received_ns)


def _are_named(publishers: Sequence[TopicEndpointInfo]) -> bool:
    """False until the nodes are known that may have another definition of our messages."""
    kinds = {info.topic_type for info in publishers}
    try:
        classes = [_message_class(kind) for kind in kinds]
    except BridgeError:  # reported when the recording of the topic starts
        return True
    return all(are_named(foreign_endpoints(publishers, each)) for each in classes)


def _message_class(kind: str) -> type:
    package, _, name = kind.split("/")
    try:
        found: type = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise BridgeError(f"message type {kind} cannot be imported: {error}") from error
    return found


def _matching_qos(reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_DEPTH,
        reliability=reliability,
        durability=durability,
    )
