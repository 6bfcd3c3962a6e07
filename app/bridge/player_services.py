"""Player controls as ROS services.

=============== =========================== ==================================
``~/play``      std_srvs/Trigger            resume at the same rate
``~/pause``     std_srvs/Trigger            pause
``~/step``      std_srvs/Trigger            pause and play one frame
``~/seek``      marginguard_msgs/Seek       jump to a time in seconds from the first frame
``~/set_rate``  marginguard_msgs/SetRate    recording seconds per second; inf: do not wait
=============== =========================== ==================================

If the player refuses a request, the response has ``success: false`` and the reason, and nothing
changes.
"""

import math
from collections.abc import Callable
from typing import Protocol

from marginguard_msgs.srv import Seek, SetRate
from std_srvs.srv import Trigger

from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class Playable(Protocol):
    """Interface of a player, such as `app.case.Player`. Called in the node's thread."""

    def resume(self) -> None:
        """Go on."""

    def pause(self) -> None:
        """Pause before the next frame."""

    def step(self, frames: int = 1) -> None:
        """Play ``frames`` frames and pause."""

    def seek(self, seconds: float) -> None:
        """Continue at this time; raises `MarginGuardError` if it is out of range."""

    def set_rate(self, rate: float | None) -> None:
        """Change the rate (None: do not wait); raises `MarginGuardError` if out of range."""


class PlayerServices:
    """Serves the controls of ``player`` on ``ros`` until the node is closed."""

    def __init__(self, ros: RosNode, player: Playable) -> None:
        self._player = player
        for name, action in (
            ("play", player.resume),
            ("pause", player.pause),
            ("step", player.step),
        ):
            ros.node.create_service(Trigger, f"~/{name}", _trigger(action))
        ros.node.create_service(Seek, "~/seek", self._seek)
        ros.node.create_service(SetRate, "~/set_rate", self._set_rate)

    def _seek(self, request: Seek.Request, response: Seek.Response) -> Seek.Response:
        response.message = _refusal(lambda: self._player.seek(request.time))
        response.success = not response.message
        response.time = request.time if response.success else math.nan
        return response

    def _set_rate(self, request: SetRate.Request, response: SetRate.Response) -> SetRate.Response:
        rate = None if request.rate == math.inf else request.rate
        response.message = _refusal(lambda: self._player.set_rate(rate))
        response.success = not response.message
        return response


def _trigger(
    action: Callable[[], None],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = _refusal(action)
        response.success = not response.message
        return response

    return serve


def _refusal(action: Callable[[], None]) -> str:
    """Call ``action``; returns the reason if it is refused, otherwise an empty string."""
    try:
        action()
    except MarginGuardError as error:
        return str(error)
    return ""
