"""Record ROS topics to a bag, and list the changes of a session while it is recorded."""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from importlib import import_module

from marginguard_msgs.msg import FixtureConstraint
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.message_definitions import are_named, foreign_endpoints
from app.bridge.message_origin import Origin
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.session_bag import offered, ros_prefixes
from app.bridge.topics import Topic
from app.case import BagTopic, BagWriter, message_definition
from app.case.new_case import SessionChange
from app.geometry import InputError, MarginGuardError

_DEPTH = 1000
_MAX_REMEMBERED = 10_000

_Key = tuple[int, int | None, int]


class RosRecorder:
    """Records ``topics`` (full names) as they appear, with the types found on the graph.

    Messages are recorded as serialised, with times of sending and of receipt.

    Call `discover`, `flush` and `sync` periodically, from any threads; a killed process loses
    messages since the last `flush`. Messages are written in the node's thread. `refused` maps each
    topic that cannot be recorded to the reason. An error of the bag is raised by every later
    `flush` and `sync`; nothing is written after it.

    Each publisher is recorded with the reliability it offers, also one that joins later with a
    weaker policy. A topic has a subscription for each combination of policies, and a message that
    arrives twice is written once. `lost` counts messages that never arrived.
    """

    def __init__(self, ros: RosNode, bag: BagWriter, topics: Sequence[str]) -> None:
        self._ros = ros
        self._bag = bag
        self._pending_topics = list(dict.fromkeys(topics))
        self._recorded: dict[str, _Recorded] = {}
        self._lock = threading.Lock()
        self._error: MarginGuardError | None = None
        self.refused: dict[str, str] = {}

    @property
    def lost(self) -> dict[str, int]:
        """By topic, messages that are missing between those received from the same publisher."""
        topics = list(self._recorded.values())
        return {topic.name: topic.lost for topic in topics if topic.lost}

    @property
    def waiting(self) -> tuple[str, ...]:
        """Topics that have no publisher yet."""
        return tuple(self._pending_topics)

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
            qos = QoSProfile(depth=_DEPTH, reliability=policies[0], durability=policies[1])
            topic = Topic(recorded.name, recorded.message_class, qos)
            self._ros.subscribe_with_origin(topic, recorded.take)

    def add_own(self, topic: BagTopic) -> None:
        """Declare a topic whose messages come by `write_own` instead of over ROS."""
        with self._lock:
            self._bag.add_topic(topic)

    def write_own(self, name: str, data: bytes) -> None:
        """Write a message of `add_own`, received now; from any thread."""
        now_ns = time.time_ns()
        self._write(name, data, now_ns, now_ns)

    def _write(self, name: str, data: bytes, received_ns: int, published_ns: int) -> None:
        with self._lock:
            if self._error is not None:
                return
            try:
                self._bag.write(name, data, received_ns=received_ns, published_ns=published_ns)
            except MarginGuardError as error:
                self._error = error


class SessionWatch:
    """Samples the constraints of a session and lists changes since the first one in `changes`.

    Ten samples per second are sufficient, because a new tumour takes longer to prepare. Each run of
    a session is followed by its ``instance_id``: a run changes when its ids do, and a run that
    joins or replaces another one is a change if its ids differ from those before it.
    """

    def __init__(self) -> None:
        self._last_received: bytes | None = None
        self._ids: dict[str, tuple[str, str]] = {}
        self._last: tuple[str, str] | None = None
        self._publishers = 0
        self.changes: list[SessionChange] = []

    def has_new_publisher(self, publishers: int) -> bool:
        """Set the number of publishers of constraints; True if one has joined another."""
        before, self._publishers = self._publishers, publishers
        return publishers > max(before, 1)

    def has_changed(self, received: tuple[int, bytes] | None) -> bool:
        """True if a constraint, given with its time of receipt, has another tumour or registration.

        ``received`` is None before the first constraint. Invalid bytes are not a change.
        """
        if received is None or received[1] is self._last_received:
            return False
        at_ns, self._last_received = received
        try:
            message = deserialize_message(self._last_received, FixtureConstraint)
        except Exception:  # rclpy raises several unrelated types for invalid bytes
            return False
        ids = (message.model_id, message.registration_id)
        before = self._ids.get(message.instance_id, self._last)
        self._ids[message.instance_id] = self._last = ids
        if before is None or before == ids:
            return False
        parts = zip(("tumour", "registration"), before, ids, strict=True)
        replaced = ", ".join(name for name, known, now in parts if known != now)
        self.changes.append(SessionChange(at_ns, *ids, replaced))
        return True

    def note_replaced(self, at_ns: int, parts: str) -> None:
        """List a change that the session itself has reported at ``at_ns``."""
        self.changes.append(SessionChange(at_ns, *(self._last or ("", "")), parts))


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
        self._seen: set[_Key] = set()
        self._in_order: deque[_Key] = deque()
        self._numbers: dict[bytes, tuple[int, int]] = {}
        self.lost = 0

    def take(self, data: bytes, origin: Origin) -> None:
        """Write a message unless it has already arrived by another subscription."""
        key = (origin.published_ns, origin.sequence, hash(data))
        if key in self._seen:
            return
        self._seen.add(key)
        self._in_order.append(key)
        if len(self._in_order) > _MAX_REMEMBERED:
            self._seen.remove(self._in_order.popleft())
        if origin.sender is not None and origin.sequence is not None:
            self._count(origin.sender, origin.sequence)
        received_ns = origin.received_ns or time.time_ns()
        self.last = received_ns, data
        self._write(self.name, data, received_ns, origin.published_ns or received_ns)

    def _count(self, sender: bytes, number: int) -> None:
        """Count the gap before message ``number``.

        A number within a gap has come later, by another subscription.
        """
        first, last = self._numbers.get(sender, (number, number - 1))
        if number > last:
            self.lost += number - last - 1
            self._numbers[sender] = first, number
        elif number > first:
            self.lost -= 1


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
