"""A robot's description from the ROS graph, loaded again whenever it changes.

Both ways are tried: the parameter of a node, and the latched topic. Whichever says something new is
taken. What comes is a stranger's text: see `app.robot.robot_from_text`.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import String

from app.bridge.calls.errors import (
    CallError,
    CallTimeoutError,
    NotThereError,
    ParameterUnsetError,
    ServerGoneError,
)
from app.bridge.calls.parameter_client import ParameterChange, ParameterClient
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, Topic
from app.bridge.robots.settings import DEFAULT_NODE, DESCRIPTION, RobotSettings
from app.geometry import MarginGuardError
from app.robot import Robot, bodies_from_mesh_map, robot_from_text

MAX_MESSAGE_BYTES = 9 * 1024 * 1024
_LOOK_AGAIN_S = 0.5
_CALL_TIMEOUT_S = 5.0
_CLOSE_S = 5.0
_MOST_WORDS = 300
_SAID_EVERY_S = 5.0


@dataclass(frozen=True, slots=True)
class DescriptionSource:
    """Which parameter of which node, and which topic; an empty name leaves that way out.

    Names without a leading ``/`` are in the robot's namespace. ``package_dirs`` and
    ``allowed_dirs`` are the folders that meshes may be in.
    """

    node: str = DEFAULT_NODE
    parameter: str = DESCRIPTION
    topic: str = DESCRIPTION
    package_dirs: tuple[str | Path, ...] = ()
    allowed_dirs: tuple[str | Path, ...] = ()

    def load(self, text: str) -> Robot:
        """The robot of a URDF."""
        return robot_from_text(text, package_dirs=self.package_dirs, allowed_dirs=self.allowed_dirs)


@dataclass(frozen=True, slots=True)
class MeshMapSource(DescriptionSource):
    """AMBF's map of meshes instead: free bodies for tf to place."""

    node: str = "/ambf"
    parameter: str = "/ambf/rigid_body_mesh_path_map"
    topic: str = ""

    def load(self, text: str) -> Robot:
        """The bodies of ``name:path;name:path``."""
        return bodies_from_mesh_map(
            text, package_dirs=self.package_dirs, allowed_dirs=self.allowed_dirs
        )


class DescriptionListener:
    """Calls ``changed(robot)`` in a thread of its own for the first description and each new one.

    One that cannot be loaded leaves the robot as it was: `problem` says why, `refused` counts them.
    A text that is repeated is not loaded again. Closed with the node, or before it by `close`.
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
        self._said: dict[str, str] = {}
        self._condition = threading.Condition()
        self._waiting: list[str] = []
        self._ask = False
        self._closing = threading.Event()
        self._client: ParameterClient | None = None
        self._subscription: Subscription | None = None
        if source.topic:
            topic = Topic(settings.topic(source.topic), String, LATCHED)
            self._subscription = ros.subscribe(topic, self._take_message, raw=True)
        if source.node:
            self._client = ParameterClient(ros, settings.topic(source.node))
            self._client.watch(self._take_change)
        ros.on_close(self.close)
        self._thread = threading.Thread(
            target=self._run, name=f"description of {settings.name}", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop listening; a description that is being loaded is not said any more."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(_CLOSE_S)
        self._ros.not_on_close(self.close)
        self._ros.call(self._leave)

    def _leave(self) -> None:
        if self._subscription is not None:
            self._ros.unsubscribe(self._subscription)
        if self._client is not None:
            self._client.close()

    def _take_message(self, raw: bytes) -> None:
        if len(raw) > MAX_MESSAGE_BYTES:
            self._refuse(f"a description has {len(raw)} bytes: {MAX_MESSAGE_BYTES} allowed")
            return
        message: String = deserialize_message(raw, String)
        with self._condition:
            self._waiting[:] = [message.data]
            self._condition.notify()

    def _take_change(self, change: ParameterChange) -> None:
        if self._source.parameter in change.values:
            with self._condition:
                self._ask = True
                self._condition.notify()

    def _run(self) -> None:
        was_there = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._waiting or self._ask or self._closing.is_set()):
                    self._condition.wait(_LOOK_AGAIN_S)
                waiting, asked = list(self._waiting), self._ask
                self._waiting.clear()
                self._ask = False
            client = self._client
            is_there = client is not None and client.is_there
            if client is not None and is_there and (asked or not was_there):
                # A node that left and came back, or could not answer, is asked again.
                is_there = self._ask_parameter(client)
            was_there = is_there
            for text in waiting:
                self._take_text("topic", text)

    def _ask_parameter(self, client: ParameterClient) -> bool:
        """Ask the node; False when it did not answer."""
        try:
            value = client.get(self._source.parameter, _CALL_TIMEOUT_S, self._closing)
        except (NotThereError, CallTimeoutError, ServerGoneError):
            return False
        except ParameterUnsetError:  # it has it on the topic, or will set it: that is an event
            return True
        except CallError as error:
            self._refuse(str(error))
            return True
        if isinstance(value, str):
            self._take_text("parameter", value)
        else:
            self._refuse(f"{self._source.parameter} of {client.node} is no text")
        return True

    def _take_text(self, way: str, text: str) -> None:
        if self._said.get(way) == text or self._closing.is_set():
            return
        is_known = text in self._said.values()
        self._said[way] = text
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

    def _refuse(self, words: str) -> None:
        self.refused += 1
        self.problem = words[:_MOST_WORDS]
        self._ros.node.get_logger().warning(
            f"description of robot {self._settings.name!r}: {self.problem}",
            throttle_duration_sec=_SAID_EVERY_S,
        )
