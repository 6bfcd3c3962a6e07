"""Names of a robot on the ROS graph, and its description, which is reloaded when it changes.

The description comes from a node's parameter or from a latched topic; any new text is loaded. The
text is untrusted input: see `app.robot.robot_from_text`.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import String

from app.bridge.calls.parameter_client import ParameterChange, ParameterClient
from app.bridge.node import RosNode
from app.bridge.ros_errors import (
    BridgeError,
    CallTimeoutError,
    FollowError,
    ParameterUnsetError,
    ServerGoneError,
    ServerUnavailableError,
)
from app.bridge.topics import LATCHED, Topic
from app.geometry import NS_PER_MS, FreshnessLimits, MarginGuardError, check_frame
from app.robot import Robot, robot_from_text

STALE_AFTER_NS = 500 * NS_PER_MS
FUTURE_TOLERANCE_NS = 50 * NS_PER_MS
"""Largest lead of the stamp of a joint state or of tf over this node's clock: the clocks of two
hosts differ, and a simulated ``/clock`` comes 40 times a second from ``ros2 bag play``."""

MAX_MESSAGE_BYTES = 9 * 1024 * 1024
_POLL_INTERVAL_S = 0.5
_CALL_TIMEOUT_S = 5.0
_JOIN_TIMEOUT_S = 5.0
_MAX_CHARS = 300
_LOG_INTERVAL_S = 5.0


def pose_limits(stale_after_ns: int) -> FreshnessLimits:
    """The limits of poses from joint states and tf; no stamp may be further ahead than behind."""
    return FreshnessLimits(
        stale_after_ns, future_tolerance_ns=min(FUTURE_TOLERANCE_NS, stale_after_ns)
    )


def absolute(name: str) -> str:
    """``name`` of a topic, with the ``/`` that it may lack."""
    return name if name.startswith("/") else f"/{name}"


@dataclass(frozen=True, slots=True)
class RobotSettings:
    """Names of a robot and its links.

    ``tf_prefix`` prefixes the names of its links in tf; a ``/`` between them is added if missing.
    ``fixed_frame`` is the unprefixed tf frame of its poses; if empty it is the prefixed root link.
    A state older than ``stale_after_ns`` is stale. Raises `FollowError` for an empty name and a
    limit that is not positive.
    """

    name: str
    tf_prefix: str = ""
    fixed_frame: str = ""
    stale_after_ns: int = STALE_AFTER_NS

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise FollowError(f"robot name is {self.name!r}; expected a name that is not blank")
        for text in (self.tf_prefix.rstrip("/"), self.fixed_frame):
            if text:
                check_frame(text)
        if self.stale_after_ns <= 0:
            raise FollowError(
                f"stale_after_ns of robot {self.name!r} is {self.stale_after_ns}; "
                "expected more than 0"
            )

    @property
    def freshness_limits(self) -> FreshnessLimits:
        """When the state is too old, and how far its stamp may be ahead."""
        return pose_limits(self.stale_after_ns)

    def frame(self, link: str) -> str:
        """Name of the tf frame of a link."""
        prefix = self.tf_prefix.rstrip("/")
        return f"{prefix}/{link}" if prefix else link

    def root_frame(self, robot: Robot) -> str:
        """Frame of the poses: ``fixed_frame`` if set, otherwise that of the root link."""
        return self.fixed_frame or self.frame(robot.root_link)


@dataclass(frozen=True, slots=True)
class DescriptionSource:
    """Parameter of a node, or a topic, that provides a description; an empty name disables one.

    ``load(text)`` makes the robot; it raises `MarginGuardError`.
    """

    node: str = ""
    parameter: str = ""
    topic: str = ""
    load: Callable[[str], Robot] = robot_from_text


class DescriptionListener:
    """Calls ``changed(robot)`` in a separate thread for the first description and each new one.

    A description that cannot be loaded is ignored: `problem` is the reason and `refused` counts
    them. Repeated text is not loaded again. Closed by `close` or with the node.
    """

    def __init__(
        self,
        ros: RosNode,
        settings: RobotSettings,
        source: DescriptionSource,
        changed: Callable[[Robot], None],
    ) -> None:
        self.problem = "no description yet"
        self.loaded = 0
        self.refused = 0
        self._ros = ros
        self._settings = settings
        self._source = source
        self._changed = changed
        self._texts: dict[str, str] = {}
        self._condition = threading.Condition()
        self._received: list[str] = []
        self._parameter_changed = False
        self._closing = threading.Event()
        self._client: ParameterClient | None = None
        self._subscription: Subscription | None = None
        if source.topic:
            topic = Topic(absolute(source.topic), String, LATCHED)
            self._subscription = ros.subscribe(topic, self._take_message, raw=True)
        if source.node:
            self._client = ParameterClient(ros, source.node)
            self._client.watch(self._take_change)
        ros.on_close(self.close)
        self._thread = threading.Thread(
            target=self._run, name=f"description of {settings.name}", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop listening; a description that is being loaded is discarded."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN_TIMEOUT_S)
        self._ros.remove_on_close(self.close)
        self._ros.call(self._destroy_endpoints)

    def _destroy_endpoints(self) -> None:
        if self._subscription is not None:
            self._ros.destroy_subscription(self._subscription)
        if self._client is not None:
            self._client.close()

    def _take_message(self, raw: bytes) -> None:
        if len(raw) > MAX_MESSAGE_BYTES:
            self._refuse(
                f"the description has {len(raw)} bytes; expected at most {MAX_MESSAGE_BYTES}"
            )
            return
        message: String = deserialize_message(raw, String)
        with self._condition:
            self._received[:] = [message.data]
            self._condition.notify()

    def _take_change(self, change: ParameterChange) -> None:
        if self._source.parameter in change.values:
            with self._condition:
                self._parameter_changed = True
                self._condition.notify()

    def _run(self) -> None:
        was_available = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._received or self._parameter_changed or self._closing.is_set()):
                    self._condition.wait(_POLL_INTERVAL_S)
                received, parameter_changed = list(self._received), self._parameter_changed
                self._received.clear()
                self._parameter_changed = False
            client = self._client
            is_available = client is not None and client.is_available
            if client is not None and is_available and (parameter_changed or not was_available):
                # False if the node did not reply, so that the next cycle reads it again.
                is_available = self._read_parameter(client)
            was_available = is_available
            for text in received:
                self._load_text("topic", text)

    def _read_parameter(self, client: ParameterClient) -> bool:
        """Get and load the parameter; False if the node did not reply."""
        try:
            value = client.get(self._source.parameter, _CALL_TIMEOUT_S, self._closing)
        except (ServerUnavailableError, CallTimeoutError, ServerGoneError):
            return False
        except ParameterUnsetError:  # it may be on the topic; setting it later is an event
            return True
        except BridgeError as error:  # also a value of an unknown type
            self._refuse(str(error))
            return True
        if isinstance(value, str):
            self._load_text("parameter", value)
        else:
            self._refuse(
                f"{self._source.parameter} of {client.node} is a {type(value).__name__}; "
                "expected a string"
            )
        return True

    def _load_text(self, origin: str, text: str) -> None:
        if self._texts.get(origin) == text or self._closing.is_set():
            return
        is_known = text in self._texts.values()
        self._texts[origin] = text
        if is_known:
            return
        try:
            robot = self._source.load(text)
        except MarginGuardError as error:
            self._refuse(str(error))
            return
        self.problem = ""
        self.loaded += 1
        if not self._closing.is_set():
            self._changed(robot)

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        self.problem = reason[:_MAX_CHARS]
        self._ros.node.get_logger().warning(
            f"description of robot {self._settings.name!r}: {self.problem}",
            throttle_duration_sec=_LOG_INTERVAL_S,
        )
