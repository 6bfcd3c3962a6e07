"""A ROS node with a context and an executor thread of its own, gone without a trace when closed."""

import atexit
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any, Self

from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from app.bridge.environment import TRANSPORTS, UDP_ON_THIS_MACHINE, promises_this_machine
from app.bridge.errors import BridgeError, reason_of
from app.bridge.open_ports import hears_other_machines
from app.bridge.qos import Topic
from app.geometry import NS_PER_S

_JOIN_S = 5.0
_FLUSH_NS = 2 * NS_PER_S
"""What was dropped is asked for every half second (`udp_on_this_machine.xml`)."""

_SAY_AGAIN_S = 1.0


class RosNode:
    """``with RosNode("marginguard") as ros: ros.node.create_publisher(...)``.

    Nothing global is touched: no ``rclpy.init``, no signal handlers, no default context; several
    can live in one process, in different domains. One executor in one thread serves parameters,
    services, subscriptions and discovery events; publishing is done from whatever thread has
    something to say. A callback that raises is said in the log and counted in `failures`: it must
    not take the others with it. Endpoints that do not hear each other because of their quality of
    service are said in the log and kept in `incompatible`. What ROS itself declares as parameters
    (``use_sim_time``) keeps the value of the start: nobody stops a guard's clock from outside.
    A node that nobody has closed is closed when the program ends. Where `prepare_environment` has
    promised that discovery stays on this machine, a node that would be heard by others is refused.

    ``ros_args`` are ROS's own (``--ros-args -r old:=new``); ``sys.argv`` is not read.
    ``make_node`` makes another kind of node, from the same arguments as `rclpy.node.Node`.
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
        self._context = Context()
        try:
            # rclpy does this too late: it lets a node of a wrong name begin, and rcl warns of that.
            validate_node_name(name)
            validate_namespace(namespace if namespace.startswith("/") else f"/{namespace}")
            self._context.init(args=["marginguard", *ros_args], domain_id=domain_id)
            self.node = make_node(name, context=self._context, namespace=namespace)
        except Exception as error:  # rclpy raises several unrelated types here
            self._context.try_shutdown()
            raise BridgeError(f"ROS node {name!r} cannot be started: {reason_of(error)}") from error
        if promises_this_machine() and hears_other_machines(self._context.get_domain_id()):
            self.node.destroy_node()
            self._context.try_shutdown()
            raise BridgeError(
                f"ROS node {name!r} would be heard by other machines: {UDP_ON_THIS_MACHINE.name} "
                f"was not read; with {TRANSPORTS}=DEFAULT ROS keeps to this one without it"
            )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: list[tuple[Topic, Publisher]] = []
        self.failures = 0
        self.incompatible: dict[str, str] = {}
        self._matched = threading.Condition()
        self._at_close: list[Callable[[], None]] = []
        self._closing = threading.Event()
        self._ending = threading.Lock()
        self._wake = self.node.create_guard_condition(lambda: None)
        for name in self.node.list_parameters([], 0).names:
            descriptor = copy(self.node.describe_parameter(name))
            if not descriptor.read_only:
                descriptor.read_only = True
                self.node.set_descriptor(name, descriptor)
        self._thread = threading.Thread(
            target=self._spin,
            name=f"{name} executor",
            daemon=True,
        )
        self._thread.start()
        # A thread that is inside ROS while Python ends would abort the program.
        atexit.register(self.close)

    def publisher(self, topic: Topic) -> Publisher:
        """A new publisher on ``topic``."""

        def matched(_: object) -> None:
            with self._matched:
                self._matched.notify_all()

        publisher = self.node.create_publisher(
            topic.type,
            topic.name,
            topic.qos,
            event_callbacks=PublisherEventCallbacks(
                matched=matched, incompatible_qos=self._said_incompatible(topic)
            ),
        )
        self._publishers.append((topic, publisher))
        return publisher

    def withdraw(self, publisher: Publisher) -> None:
        """Take a publisher of ours out of the graph; for the node's own thread.

        From another one it would break the wait of this one's executor.
        """
        self._publishers = [entry for entry in self._publishers if entry[1] is not publisher]
        if self.is_open:
            self.node.destroy_publisher(publisher)

    def subscribe(
        self, topic: Topic, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Call ``callback(message)`` in the node's thread; with ``raw`` it gets the bytes."""
        return self.node.create_subscription(
            topic.type,
            topic.name,
            callback,
            topic.qos,
            raw=raw,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._said_incompatible(topic)
            ),
        )

    def unsubscribe(self, subscription: Subscription) -> None:
        """Hear a topic no more; for the node's own thread, as `withdraw`."""
        if self.is_open:
            self.node.destroy_subscription(subscription)

    def wait_for_subscribers(self, topic: Topic, count: int, timeout_s: float) -> bool:
        """Wait until each publisher of ``topic`` has ``count`` subscribers; False when in vain.

        Woken by discovery itself, nothing is polled.
        """
        publishers = [publisher for of, publisher in self._publishers if of is topic]
        with self._matched:
            return self._matched.wait_for(
                lambda: all(each.get_subscription_count() >= count for each in publishers),
                timeout_s,
            )

    def on_close(self, end: Callable[[], None]) -> None:
        """Call ``end()`` when `close` begins, while everything is still served; the last first."""
        self._at_close.append(end)

    def not_on_close(self, end: Callable[[], None]) -> None:
        """Forget ``end``, which has been called before the node is closed."""
        self._at_close = [each for each in self._at_close if each != end]

    @property
    def in_own_thread(self) -> bool:
        """Whether the caller is a callback of this node: waiting for another would never end."""
        return threading.current_thread() is self._thread

    @property
    def is_open(self) -> bool:
        """False from the moment on at which `close` takes the graph away."""
        return self._context.ok() and not self._closing.is_set()

    def close(self) -> None:
        """Deliver what was published, stop serving, leave the ROS graph; once is enough.

        A subscriber that does not acknowledge (killed, hung) is waited for two seconds at most.
        Raises `BridgeError` in the node's own thread, which a callback cannot end.
        """
        if not self._context.ok():
            return
        if self.in_own_thread:
            raise BridgeError(
                f"ROS node {self.node.get_name()!r} cannot be closed by a callback of its own"
            )
        atexit.unregister(self.close)
        while self._at_close:
            self._at_close.pop()()
        self.flush()
        # The thread first: an executor that is shut down under its own feet destroys the guard
        # condition that it waits for.
        with self._ending:
            self._closing.set()
        self._wake.trigger()
        self._thread.join(_JOIN_S)
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def flush(self) -> None:
        """Wait until subscribers have got what was published, for two seconds at most."""
        until_ns = time.monotonic_ns() + _FLUSH_NS
        for _, publisher in self._publishers:
            remaining_ns = max(0, until_ns - time.monotonic_ns())
            if not publisher.wait_for_all_acked(Duration(nanoseconds=remaining_ns)):
                return  # a subscriber that hangs, or has yet to say that it has got everything

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` in the node's thread, after what it is at; never on a closed node."""
        with self._ending:
            if self.is_open:
                self._executor.create_task(callback)

    def call(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` in the node's thread and return when it is done.

        Nothing is called on a closed node. Raises `BridgeError` when the thread is held up.
        """
        if self.in_own_thread:
            callback()
            return
        done = threading.Event()

        def work() -> None:
            try:
                callback()
            finally:
                done.set()

        self.call_soon(work)
        if self.is_open and not done.wait(_JOIN_S) and self.is_open:
            raise BridgeError(f"the thread of ROS node {self.node.get_name()!r} is held up")

    def wake(self) -> None:
        """Let the node's thread look again at what its callbacks wait for; from any thread."""
        with self._ending:
            if self.is_open:
                self._executor.wake()

    def _spin(self) -> None:
        # Not `spin_until_future_complete`: it hangs a callback on the future for every message.
        while self._context.ok() and not self._closing.is_set():
            try:
                self._executor.spin_once()
            except Exception:  # of a callback, whatever it may be
                self.failures += 1
                self.node.get_logger().error(
                    f"a callback failed: {traceback.format_exc()}",
                    throttle_duration_sec=_SAY_AGAIN_S,
                )

    def _said_incompatible(
        self, topic: Topic
    ) -> Callable[[QoSOfferedIncompatibleQoSInfo | QoSRequestedIncompatibleQoSInfo], None]:
        def said(info: QoSOfferedIncompatibleQoSInfo | QoSRequestedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(info.last_policy_kind)
            self.incompatible[topic.name] = policy
            self.node.get_logger().warning(
                f"{topic.name}: another endpoint is not heard, its {policy} does not fit ours"
            )

        return said

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
