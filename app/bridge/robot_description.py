"""Names of a robot on the ROS graph, and its description, which is reloaded when it changes.

The description comes from a node's parameter or from a latched topic; any new text is loaded. The
text is untrusted input: see `app.robot.robot_from_text`.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import String

from app.bridge.calls.parameter_client import ParameterWatch
from app.bridge.node import RosNode
from app.bridge.ros_errors import FollowError
from app.bridge.topics import LATCHED, Topic
from app.geometry import NS_PER_MS, FreshnessLimits, MarginGuardError, check_frame
from app.robot import Robot, robot_from_text

STALE_AFTER_NS = 500 * NS_PER_MS
FUTURE_TOLERANCE_NS = 50 * NS_PER_MS
"""Largest lead of the stamp of a joint state or of tf over this node's clock: the clocks of two
hosts differ, and a simulated ``/clock`` comes 40 times a second from ``ros2 bag play``."""

MAX_MESSAGE_BYTES = 9 * 1024 * 1024
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
        self._received: deque[str] = deque(maxlen=1)
        self._woken = threading.Event()
        self._closing = threading.Event()
        self._watch: ParameterWatch | None = None
        self._subscription: Subscription | None = None
        if source.topic:
            topic = Topic(absolute(source.topic), String, LATCHED)
            self._subscription = ros.subscribe(topic, self._take_message, raw=True)
        if source.node:
            self._watch = ParameterWatch(ros, source.node, self._woken.set)
            self._watch.add(source.parameter)
        ros.on_close(self.close)
        self._thread = threading.Thread(
            target=self._run, name=f"description of {settings.name}", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop listening; a description that is being loaded is discarded."""
        self._closing.set()
        self._woken.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_JOIN_TIMEOUT_S)
        self._ros.remove_on_close(self.close)
        if self._watch is not None:
            self._watch.close()
        subscription = self._subscription
        if subscription is not None:
            self._ros.call(lambda: self._ros.destroy_subscription(subscription))

    def _take_message(self, raw: bytes) -> None:
        if len(raw) > MAX_MESSAGE_BYTES:
            self._refuse(
                f"the description has {len(raw)} bytes; expected at most {MAX_MESSAGE_BYTES}"
            )
            return
        message: String = deserialize_message(raw, String)
        self._received.append(message.data)
        self._woken.set()

    def _run(self) -> None:
        while self._woken.wait() and not self._closing.is_set():
            self._woken.clear()
            if self._watch is not None:
                self._load_parameter(self._watch)
            while self._received:
                self._load_text("topic", self._received.popleft())

    def _load_parameter(self, watch: ParameterWatch) -> None:
        """Load a new value; without one the description may be on the topic."""
        name = self._source.parameter
        value = watch.take().get(name)
        if isinstance(value, str):
            self._load_text("parameter", value)
        elif value is not None:
            self._refuse(f"{name} of {watch.node} is a {type(value).__name__}; expected a string")

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
