"""CRTK's ``operating_state`` and ``state_command`` of one arm, where ``crtk_msgs`` is installed."""

from collections import deque
from typing import Any

from app.bridge.convert.errors import UnknownTypeError
from app.bridge.convert.types import message_type
from app.bridge.messages import header_message
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, NEWEST, Topic
from app.geometry import Stamp
from app.simulation import ArmState, StateCommand

_MAX_WAITING = 20
_MAX_CHARS = 40


class ArmStateTopics:
    """Publishes the state at each change, latched; keeps commands until they are taken."""

    def __init__(self, ros: RosNode, arm: str) -> None:
        self._arm, self._node = arm, ros.node
        self._waiting: deque[str] = deque(maxlen=_MAX_WAITING)
        self._last: tuple[str, bool] | None = None
        self._publisher: Any = None
        try:
            self._type = message_type("crtk_msgs/msg/OperatingState")
            command_type = message_type("crtk_msgs/msg/StringStamped")
        except UnknownTypeError:
            ros.node.get_logger().info(
                f"/{arm}/operating_state and /{arm}/state_command are missing: crtk_msgs is not "
                "installed (see docs/installation.md); the state is on /diagnostics"
            )
            return
        self._publisher = ros.publisher(Topic(f"/{arm}/operating_state", self._type, LATCHED))
        ros.subscribe(Topic(f"/{arm}/state_command", command_type, NEWEST), self._take)

    def commands(self) -> list[StateCommand]:
        """The commands that have arrived since the last call; others are logged and ignored."""
        found = []
        while self._waiting:
            text = self._waiting.popleft()
            try:
                found.append(StateCommand(text))
            except ValueError:
                self._node.get_logger().warning(
                    f"/{self._arm}/state_command is {text[:_MAX_CHARS]!r}; "
                    f"expected one of {', '.join(StateCommand)}"
                )
        return found

    def publish(self, state: ArmState, stamp: Stamp) -> None:
        """Publish ``state`` if it is another one than before."""
        now = str(state.status), state.is_busy
        if self._publisher is None or now == self._last:
            return
        self._last = now
        self._publisher.publish(
            self._type(
                header=header_message("", stamp), state=now[0], is_homed=True, is_busy=now[1]
            )
        )

    def _take(self, message: Any) -> None:
        self._waiting.append(message.string)
