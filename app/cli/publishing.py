"""Where the steps of a session go: to the ROS graph, or nowhere."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.case import Case, Player
    from app.session import SessionSetup, StepResult

HEARTBEAT_HZ = 100.0
"""How often the constraint is repeated while a session follows real time."""


def bridge_loaded(otherwise: str) -> None:
    """Load ROS and say how far it is heard; `InputError` without ROS, ``otherwise`` in its text."""
    try:
        from app.bridge import prepare_environment
    except ImportError as error:
        from app.geometry import InputError

        raise InputError(
            f"ROS 2 cannot be loaded ({error}): "
            f"'marginguard doctor' says what to install, {otherwise}"
        ) from error
    print(prepare_environment(), file=sys.stderr)


@contextmanager
def publishing(
    case: "Case", setup: "SessionSetup", player: "Player", options: argparse.Namespace
) -> Iterator[Callable[["StepResult"], object]]:
    """Give a function that publishes a step, and let ``player`` be controlled over ROS.

    With ``--no-ros`` the function does nothing, and no ROS is loaded.
    """
    if options.no_ros:
        yield lambda step: None
        return
    bridge_loaded("--no-ros replays without it")
    from app.bridge import PlayerServices, SessionPublisher, scene_of

    heartbeat_hz = HEARTBEAT_HZ if options.rate is not None else None
    scene = scene_of(case, setup, tip_only=options.tip_only)
    with SessionPublisher(scene, heartbeat_hz=heartbeat_hz) as publisher:
        PlayerServices(publisher.ros, player)
        yield publisher.publish
