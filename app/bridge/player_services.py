"""The player's controls as services, so that RViz, a script or a second screen can hold a replay.

=============== =========================== ==================================
``~/play``      std_srvs/Trigger            go on at the same rate
``~/pause``     std_srvs/Trigger            hold the next frame back
``~/step``      std_srvs/Trigger            pause, and let one frame pass
``~/seek``      marginguard_msgs/Seek       seconds from the first frame
``~/set_rate``  marginguard_msgs/SetRate    recording seconds per second, infinity: no waiting
=============== =========================== ==================================

What the player refuses comes back as ``success: false`` with its reason; nothing is changed then.
"""

import math
from collections.abc import Callable
from typing import Protocol

from marginguard_msgs.srv import Seek, SetRate
from std_srvs.srv import Trigger

from app.bridge.node import RosNode
from app.geometry import MarginGuardError


class Playable(Protocol):
    """What is asked of a player: `app.case.Player` is one. Called from the node's own thread."""

    def resume(self) -> None:
        """Go on."""

    def pause(self) -> None:
        """Hold the next frame back."""

    def step(self, frames: int = 1) -> None:
        """Let a frame pass and stay paused."""

    def seek(self, seconds: float) -> None:
        """Go on from there; raises `MarginGuardError` for a time that cannot be."""

    def set_rate(self, rate: float | None) -> None:
        """Change the rate, None: no waiting; raises `MarginGuardError` when out of range."""


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
    """Empty when the action was done, the reason when the player refused it."""
    try:
        action()
    except MarginGuardError as error:
        return str(error)
    return ""
