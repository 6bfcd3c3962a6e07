"""Where the steps of a replay go: to the ROS graph, or nowhere."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.case import Case, Player
    from app.session import SessionSetup, StepResult

HEARTBEAT_HZ = 100.0
"""How often the constraint is repeated while a replay follows real time."""


@contextmanager
def publishing(
    case: "Case", setup: "SessionSetup", player: "Player", options: argparse.Namespace
) -> Iterator[Callable[["StepResult"], None]]:
    """Give a function that publishes a step, and let ``player`` be controlled over ROS.

    With ``--no-ros`` the function does nothing, and no ROS is loaded.
    """
    if options.no_ros:
        yield lambda step: None
        return
    try:
        from app.bridge import (
            PlayerServices,
            SessionPublisher,
            ReplayScene,
            prepare_environment,
            root_edges,
        )
    except ImportError as error:
        from app.geometry import InputError

        raise InputError(
            f"ROS 2 cannot be loaded ({error}): "
            "'marginguard doctor' says what to install, --no-ros replays without it"
        ) from error
    print(prepare_environment(), file=sys.stderr)
    robot = setup.robot
    scene = ReplayScene(
        static_edges=(
            *setup.static_edges,
            *(root_edges(robot.base_frame, robot.robot.root_link) if robot else ()),
        ),
        tumor=case.tumor_mesh(),
        tool=None if options.tip_only else case.tool_mesh(),
        margins=setup.margins,
        robot_description=case.robot_urdf().read_text(encoding="utf-8") if robot else None,
        registration=robot.registration.transform if robot and robot.registration else None,
    )
    heartbeat_hz = HEARTBEAT_HZ if options.rate is not None else None
    with SessionPublisher(scene, heartbeat_hz=heartbeat_hz) as publisher:
        PlayerServices(publisher.ros, player)
        yield publisher.publish
