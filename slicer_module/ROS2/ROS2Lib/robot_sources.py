"""Where the description of a displayed robot comes from."""

import threading
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from app.bridge import RosNode
from app.bridge.robot_description import (
    DescriptionListener,
    DescriptionSource,
    MeshMapSource,
    RobotSettings,
)
from app.geometry import MarginGuardError
from app.robot import Robot, load_robot
from ROS2Lib.errors import Ros2Error

PARAMETER, TOPIC, FILE, MESH_MAP = SOURCES = ("parameter", "topic", "file", "mesh map")
DEFAULTS = MappingProxyType(
    {
        PARAMETER: ("/robot_state_publisher", "robot_description"),
        TOPIC: ("", "/robot_description"),
        FILE: ("", ""),
        MESH_MAP: ("/ambf", "/ambf/rigid_body_mesh_path_map"),
    }
)
"""Node and name (of a parameter, a topic, a file) that belong to each source."""


class Description(Protocol):
    """A description that is loaded in a thread of its own."""

    problem: str

    def close(self) -> None:
        """Stop loading."""


class FileDescription:
    """Loads a URDF, xacro or ADF file once, in a thread."""

    def __init__(self, path: str, loaded: Callable[[Robot], None]) -> None:
        self.problem = "the file is being loaded"
        self._path = Path(path)
        self._loaded = loaded
        self._is_closed = False
        threading.Thread(target=self._load, name=f"description {path}", daemon=True).start()

    def close(self) -> None:
        """Discard a robot that is being loaded."""
        self._is_closed = True

    def _load(self) -> None:
        try:
            robot = load_robot(self._path)
        except (MarginGuardError, OSError) as error:
            self.problem = str(error)
            return
        self.problem = ""
        if not self._is_closed:
            self._loaded(robot)


def description(
    source: str,
    ros: RosNode,
    settings: RobotSettings,
    node: str,
    name: str,
    loaded: Callable[[Robot], None],
) -> Description:
    """Start loading; ``loaded(robot)`` is called for the first robot and each new one.

    Raises `Ros2Error` for an empty name.
    """
    needed = {"node name": node} if source in (PARAMETER, MESH_MAP) else {}
    for what, value in {**needed, f"{source} name": name}.items():
        if not value.strip("/"):
            raise Ros2Error(f"robot {settings.name!r}: {what} is empty; expected a name")
    if source == FILE:
        return FileDescription(name, loaded)
    if source == TOPIC:
        graph = DescriptionSource(node="", parameter="", topic=name)
    elif source == MESH_MAP:
        graph = MeshMapSource(f"/{node.strip('/')}", name)
    else:
        graph = DescriptionSource(f"/{node.strip('/')}", name, topic="")
    return DescriptionListener(ros, settings, graph, loaded)
