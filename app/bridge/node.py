"""ROS node with its own context and executor thread. Releases all ROS resources on close."""

import atexit
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any, Self

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_policy_name_from_kind
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from app.bridge.environment import (
    TRANSPORTS,
    UDP_ON_THIS_MACHINE,
    check_security,
    finish_discovery,
    keeps_to_this_machine,
    listens_to_other_machines,
)
from app.bridge.message_definitions import (
    DefinitionWatch,
    check_installed,
    checked_callback,
    expected_digest,
)
from app.bridge.message_origin import ReceiveFrom, Receiver
from app.bridge.message_thread import MessageThread, TurnExecutor
from app.bridge.ros_errors import BridgeError, reason_of
from app.bridge.topics import Topic
from app.geometry import NS_PER_S

_JOIN_TIMEOUT_S = 5.0
_FLUSH_TIMEOUT_NS = 2 * NS_PER_S
"""Writers announce lost data every 0.5 s (`udp_on_this_machine.xml`), so this allows 4 retries."""

_FLUSH_POLL_S = 0.002

_LOG_INTERVAL_S = 1.0


class RosNode:
    """``with RosNode("marginguard") as ros: ros.node.create_publisher(...)``.

    Uses no global state: no ``rclpy.init``, no signal handlers, no default context. One process
    can have several nodes in different domains. One thread serves parameters, services, timers and
    discovery events, another one messages; one callback at a time runs, but for those of `poll`,
    which run in the thread that calls it. Any thread may publish. An exception in a callback is
    logged and counted in `failures`; the other callbacks continue. Endpoints with incompatible
    quality of service are logged and listed in `incompatible`. Parameters declared by ROS itself
    (``use_sim_time``) become read-only, so that other nodes cannot stop the clock of this node. An
    open node is closed at the end of the program.

    Raises `SecurityError` if ROS security is asked for and not available, and `BridgeError` if the
    node cannot start, or if it would be visible to other machines
    although `prepare_environment` has restricted discovery to this machine.

    ``ros_args`` are ROS arguments (``--ros-args -r old:=new``); ``sys.argv`` is not read.
    ``make_node`` creates another type of node, with the arguments of `rclpy.node.Node`.
    """

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "",
        ros_args: Sequence[str] = (),
        domain_id: int | None = None,
        make_node: Callable[..., Node] = Node,
    ) -> None:
        check_installed()
        check_security()
        self._context = Context()
        try:
            # rclpy validates names only after it has created the rcl node, which then warns.
            validate_node_name(name)
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
            self._context.init(args=["marginguard", *ros_args], domain_id=domain_id)
            self.node = make_node(name, context=self._context, namespace=namespace)
        except Exception as error:  # rclpy raises several unrelated types here
            self._context.try_shutdown()
            raise BridgeError(f"ROS node {name!r} cannot be started: {reason_of(error)}") from error
        if keeps_to_this_machine() and listens_to_other_machines(self._context.get_domain_id()):
            self._leave()
            raise BridgeError(
                f"ROS node {name!r} would be visible to other machines: Fast DDS did not read "
                f"{UDP_ON_THIS_MACHINE.name}; set {TRANSPORTS}=DEFAULT to stay on this machine "
                "without it"
            )
        turn = threading.RLock()
        self.failures = 0
        self._messages = MessageThread(f"{name} messages", turn, self._callback_failed)
        self._executor = TurnExecutor(turn, self._messages, context=self._context)
        self._executor.add_node(self.node)
        self._publishers: list[tuple[Topic, Publisher]] = []
        self._watches: dict[object, DefinitionWatch] = {}
        self.incompatible: dict[str, str] = {}
        self._matched = threading.Condition()
        self._close_callbacks: list[Callable[[], None]] = []
        self._closing = threading.Event()
        self._closing_lock = threading.Lock()
        self._wake = self.node.create_guard_condition(lambda: None)
        for parameter in self.node.list_parameters([], 0).names:
            descriptor = copy(self.node.describe_parameter(parameter))
            if not descriptor.read_only:
                descriptor.read_only = True
                self.node.set_descriptor(parameter, descriptor)
        self._thread = threading.Thread(
            target=self._spin,
            name=f"{name} executor",
            daemon=True,
        )
        self._thread.start()
        # A thread inside ROS during interpreter shutdown would abort the program.
        atexit.register(self.close)

    def publisher(self, topic: Topic) -> Publisher:
        """Create a publisher on ``topic``."""

        def on_matched(_: object) -> None:
            with self._matched:
                self._matched.notify_all()
            for watch in watched:
                watch.check()

        watched: list[DefinitionWatch] = []
        publisher = self.node.create_publisher(
            topic.type,
            topic.name,
            topic.qos,
            event_callbacks=PublisherEventCallbacks(
                matched=on_matched, incompatible_qos=self._incompatible_qos_callback(topic)
            ),
        )
        self._publishers.append((topic, publisher))
        if expected_digest(topic.type) is not None:
            watched.append(self._watch_subscribers(topic, publisher))
        return publisher

    def destroy_publisher(self, publisher: Publisher) -> None:
        """Destroy a publisher of this node. Call it in a callback of the node."""
        self._publishers = [entry for entry in self._publishers if entry[1] is not publisher]
        self._watches.pop(publisher, None)
        self._in_executor(lambda: self.node.destroy_publisher(publisher))

    def warn(self, text: str) -> None:
        """Log ``text`` as a warning of this node."""
        self.node.get_logger().warning(text)

    def subscribe(
        self, topic: Topic, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Create a subscription that calls ``callback(message)`` as a callback of the node.

        With ``raw`` the callback receives the serialised bytes. It is not called while a publisher
        has another definition of one of our messages (`definition_problems`).
        """
        if raw:
            return self.subscribe_with_origin(topic, lambda data, _: callback(data))
        return self.subscribe_with_origin(
            topic, lambda data, _: callback(deserialize_message(data, topic.type))
        )

    def subscribe_with_origin(
        self, topic: Topic, callback: ReceiveFrom, *, polled: bool = False
    ) -> Subscription:
        """Subscribe with ``raw``; ``callback(data, origin)`` also receives the origin.

        With ``polled`` it is called by `poll` alone, so that no message wakes a thread: for a loop
        that is slower than its messages. ``topic.qos`` has to keep those of one round.
        """
        created: list[Subscription] = []  # empty while a callback may already be called
        watched: list[DefinitionWatch] = []
        if expected_digest(topic.type) is not None:
            watched.append(self._watch_publishers(topic, created))
            callback = checked_callback(callback, watched[0])

        def on_matched(_: object) -> None:
            for watch in watched:
                watch.check()

        subscription = self.node.create_subscription(
            topic.type,
            topic.name,
            # rclpy passes the origin to a callback with two parameters.
            Receiver(callback),  # type: ignore[arg-type]
            topic.qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=on_matched, incompatible_qos=self._incompatible_qos_callback(topic)
            ),
        )
        created.append(subscription)
        for watch in watched:
            self._watches[subscription] = watch
        self._messages.add(subscription, polled=polled)
        return subscription

    def poll(self, subscription: Subscription) -> None:
        """Call the callback of a polled subscription, in this thread, for what has come.

        Without the functions of rcl (`app.bridge.message_origin`) the node's thread has called it.
        """
        self._messages.poll(subscription)

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call ``callback()`` in the node's thread every ``period_s`` of a steady clock."""
        return self.node.create_timer(
            period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def cancel(self, timer: Timer) -> None:
        """Stop a timer of `every` before its next call, or the one after it.

        In another thread `Timer.cancel` makes rclpy's executor raise, if the timer is due.
        """
        self._in_executor(timer.cancel)

    @property
    def definition_problems(self) -> list[str]:
        """Texts that name the nodes with other definitions of our messages, and the remedy."""
        watches = list(self._watches.values())
        return [watch.problem for watch in watches if not watch.is_clean() and watch.problem]

    def destroy_subscription(self, subscription: Subscription) -> None:
        """Destroy a subscription, of which no message comes any more. Call it in a callback."""
        self._watches.pop(subscription, None)
        self._messages.remove(subscription)
        self._in_executor(lambda: self.node.destroy_subscription(subscription))

    def wait_for_subscribers(self, topic: Topic, count: int, timeout_s: float) -> bool:
        """Wait until each publisher of ``topic`` has ``count`` subscribers; False on timeout.

        Discovery events wake the wait; nothing is polled.
        """
        publishers = [publisher for each, publisher in self._publishers if each is topic]
        with self._matched:
            return self._matched.wait_for(
                lambda: all(each.get_subscription_count() >= count for each in publishers),
                timeout_s,
            )

    def on_close(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` when `close` begins, before anything stops; last added, first run."""
        self._close_callbacks.append(callback)

    def remove_on_close(self, callback: Callable[[], None]) -> None:
        """Remove a callback that was added with `on_close`."""
        self._close_callbacks = [each for each in self._close_callbacks if each != callback]

    @property
    def in_own_thread(self) -> bool:
        """True in a callback of this node, which must not wait for another callback."""
        return threading.current_thread() is self._thread or self._messages.is_current

    @property
    def is_open(self) -> bool:
        """False once `close` has started to leave the ROS graph."""
        return self._context.ok() and not self._closing.is_set()

    def close(self) -> None:
        """Flush publishers, stop serving, leave the ROS graph. Idempotent.

        Waits 2 s at most for subscribers that do not acknowledge. Raises `BridgeError` in the
        node's own thread, because a callback cannot end that thread.
        """
        if not self._context.ok():
            return
        if self.in_own_thread:
            raise BridgeError(
                f"ROS node {self.node.get_name()!r} cannot be closed in one of its own callbacks"
            )
        atexit.unregister(self.close)
        while self._close_callbacks:
            self._close_callbacks.pop()()
        self.flush()
        # Join the thread first: shutting the executor down while it spins destroys the guard
        # condition that it waits for.
        with self._closing_lock:
            self._closing.set()
        self._wake.trigger()
        self._messages.close(_JOIN_TIMEOUT_S)
        self._thread.join(_JOIN_TIMEOUT_S)
        self._executor.shutdown()
        self._leave()

    def _leave(self) -> None:
        finish_discovery(self.node.handle.pointer)
        self.node.destroy_node()
        self._context.try_shutdown()

    def flush(self) -> None:
        """Wait until reliable subscribers have acknowledged all messages, 2 s at most."""
        end_ns = time.monotonic_ns() + _FLUSH_TIMEOUT_NS
        for _, publisher in self._publishers:
            # Polled: rclpy blocks all threads of the process while it waits.
            while not publisher.wait_for_all_acked(Duration()):
                if time.monotonic_ns() >= end_ns:
                    return
                time.sleep(_FLUSH_POLL_S)

    def call_soon(self, callback: Callable[[], object]) -> None:
        """Schedule ``callback()`` in the node's thread; does nothing on a closed node."""
        with self._closing_lock:
            if self.is_open:
                self._executor.create_task(callback)

    def call(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` in the node's thread and wait until it has returned.

        Does nothing on a closed node. Raises `BridgeError` if the thread is blocked.
        """
        if self.in_own_thread:
            callback()
            return
        done = threading.Event()

        def run() -> None:
            try:
                callback()
            finally:
                done.set()

        self.call_soon(run)
        if self.is_open and not done.wait(_JOIN_TIMEOUT_S) and self.is_open:
            raise BridgeError(f"the thread of ROS node {self.node.get_name()!r} is blocked")

    def wake(self) -> None:
        """Wake the executor so that it resumes coroutines whose futures are done. Thread-safe."""
        with self._closing_lock:
            if self.is_open:
                self._executor.wake()

    def _spin(self) -> None:
        # Not `spin_until_future_complete`: it adds a callback to the future for every message.
        while self._context.ok() and not self._closing.is_set():
            try:
                self._executor.spin_once()
            except Exception:  # raised by a callback
                self._callback_failed()

    def _callback_failed(self) -> None:
        self.failures += 1
        self.node.get_logger().error(
            f"a callback failed: {traceback.format_exc()}", throttle_duration_sec=_LOG_INTERVAL_S
        )

    def _in_executor(self, destroy: Callable[[], object]) -> None:
        """Call ``destroy()`` in the thread that waits for the node's entities, or soon after."""
        if threading.current_thread() is self._thread:
            if self.is_open:
                destroy()
        else:
            self.call_soon(destroy)

    def _watch_publishers(self, topic: Topic, created: Sequence[Subscription]) -> DefinitionWatch:
        name = self.node.resolve_topic_name(topic.name)
        return DefinitionWatch(
            name,
            topic.type,
            "so that its messages are not used",
            lambda: self.node.get_publishers_info_by_topic(name),
            lambda: sum(each.get_publisher_count() for each in created),
            self.node.get_logger().error,
        )

    def _watch_subscribers(self, topic: Topic, publisher: Publisher) -> DefinitionWatch:
        watch = self._watches[publisher] = DefinitionWatch(
            publisher.topic_name,
            topic.type,
            "so that it misreads our messages",
            lambda: self.node.get_subscriptions_info_by_topic(publisher.topic_name),
            publisher.get_subscription_count,
            self.node.get_logger().error,
        )
        return watch

    def _incompatible_qos_callback(
        self, topic: Topic
    ) -> Callable[[QoSOfferedIncompatibleQoSInfo | QoSRequestedIncompatibleQoSInfo], None]:
        def on_incompatible(
            info: QoSOfferedIncompatibleQoSInfo | QoSRequestedIncompatibleQoSInfo,
        ) -> None:
            policy = qos_policy_name_from_kind(info.last_policy_kind)
            self.incompatible[topic.name] = policy
            self.node.get_logger().warning(
                f"{topic.name}: not connected to another endpoint because of incompatible {policy}"
            )

        return on_incompatible

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
