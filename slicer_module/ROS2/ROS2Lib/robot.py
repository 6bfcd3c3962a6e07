"""Robots: a description from the graph or a file, and poses from tf or joint states."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge import RosNode
from app.bridge.robot_description import (
    DescriptionListener,
    DescriptionSource,
    RobotSettings,
)
from app.geometry import MarginGuardError
from app.robot import Robot, bodies_from_mesh_map, load_robot, robot_from_text
from app.runtime.thread_handover import LatestValue
from ROS2Lib.member import Member, Owner, Ros2Error
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.robot_kinematics import RobotMoveIt
from ROS2Lib.robot_links import JointLinks, TfLinks, create_goal, remove_goal

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


Description = FileDescription | DescriptionListener
"""A description that is loaded in a thread of its own."""


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
        graph = DescriptionSource(topic=name)
    else:
        load = bodies_from_mesh_map if source == MESH_MAP else robot_from_text
        graph = DescriptionSource(f"/{node.strip('/')}", name, load=load)
    return DescriptionListener(ros, settings, graph, loaded)


_ORDER = ("robot", "node", "parameter", "frame", "prefix")
_OLD_ORDER = ("node", "parameter", "robot", "frame", "prefix")


class vtkMRMLROS2RobotNode(RobotMoveIt, Member, vtkMRMLScriptedModuleNode):
    """One model ``<link>_model`` per link, below its lookup ``ros2:tf2lookup:<parent>To<child>``.

    Links stand at their zero pose until tf (or joint states, see `JointLinks`) provides one, and
    all are grey while any pose is not valid: a coloured robot is at its measured pose. The robot is
    rebuilt when the description changes. ``ModifiedEvent`` is invoked after a build and when the
    robot turns grey or coloured.
    """

    ROLE = "robot"

    def __init__(self) -> None:
        self._settings: RobotSettings | None = None
        self._name = ""
        self._description: Description | None = None
        self._source = PARAMETER
        self._joint_states = ""
        self._described: LatestValue[Robot] = LatestValue()
        self._robot: Robot | None = None
        self._links: TfLinks | JointLinks | None = None
        self._is_stale = True

    def GetRobotName(self) -> str:
        """The robot's name."""
        return self._name if self._settings is None else self._settings.name

    def SetRobotName(self, robotName: str) -> None:
        """Set the name with which `AddToROS2Node` adds the robot."""
        self._check_not_added()
        self._name = robotName
        self.SetName(f"ros2:robot:{robotName}")

    def AddToROS2Node(self, nodeId: str, *names: str) -> bool:
        """Add it to a ROS node; on error log it, return False.

        ``names``: robot, parameter node, parameter (``robot_description``), fixed frame, tf
        prefix; the last three may be left out. As in older versions of SlicerROS2, a first name
        that begins with ``/`` or stands alone is the parameter node; then follow parameter, robot
        (by default that of `SetRobotName`, or ``robot``), fixed frame and prefix.
        """
        if not 1 <= len(names) <= len(_OLD_ORDER):
            logging.error(f"{self.GetName()}: {len(names)} names; expected 1 to {len(_OLD_ORDER)}")
            return False
        order = _OLD_ORDER if len(names) == 1 or names[0].startswith("/") else _ORDER
        given = dict(zip(order, names, strict=False))
        name = given.get("robot") or self._name or "robot"
        parameter = given.get("parameter", "robot_description")
        rest = (given.get("frame", ""), given.get("prefix", ""))
        return self.add_to(nodeId, (name, given["node"], parameter, *rest))

    def SetDescriptionSource(self, source: str) -> None:
        """Set where the description comes from, before the robot is added.

        ``parameter`` (of the parameter node), ``topic``, ``file`` (URDF, xacro or ADF) or ``mesh
        map`` (a parameter of AMBF); the parameter's name is then that of the topic or the file.
        """
        self._check_not_added()
        if source not in SOURCES:
            raise Ros2Error(f"source is {source!r}; expected one of {', '.join(SOURCES)}")
        self._source = source

    def SetJointStatesTopic(self, topic: str) -> None:
        """Set the topic of the joint states to follow, before the robot is added; empty: tf."""
        self._check_not_added()
        self._joint_states = topic

    def _check_not_added(self) -> None:
        if self.IsAddedToROS2Node():
            raise Ros2Error(f"{self.GetName()}: it must be set before it is added to a ROS node")

    def SetRobotDescriptionParameterNode(
        self, node: vtkMRMLROS2ParameterNode | None = None
    ) -> bool:
        """Refer to the node that monitors the description, role ``parameter``; False on error.

        Without ``node`` it is the ROS node's parameter node, which is created if it has none. The
        description itself is received by the robot.
        """
        if self._owner is None or self._settings is None:
            logging.error(f"{self.GetName()} is not on a ROS node; add it first")
            return False
        if node is None:
            _, monitored, parameter, *_ = self._names
            found = self._owner.find(vtkMRMLROS2ParameterNode, monitored)
            node = found or self._owner.create(vtkMRMLROS2ParameterNode, monitored)
            if node is None:
                return False
            if parameter not in node.GetMonitoredParameters():
                node.AddParameter(parameter)
        self.SetNodeReferenceID("parameter", node.GetID())
        return True

    def ObserveParameterNode(self, node: vtkMRMLROS2ParameterNode) -> None:
        """Call `SetRobotDescriptionParameterNode`."""
        self.SetRobotDescriptionParameterNode(node)

    def ParseRobotDescription(self) -> bool:
        """True if a description was received and is valid."""
        return self._robot is not None

    def SetupRobotVisualization(self) -> None:
        """Build the robot again from its last description."""
        if self._robot is not None:
            self._described.put(self._robot)
            self.spin()

    def RemoveRobotVisualization(self) -> None:
        """Remove models and lookups until `SetupRobotVisualization` or a new description."""
        self._clear()

    def CreateGoalStateRobot(self, sourceRobot: "vtkMRMLROS2RobotNode") -> bool:
        """Show a translucent copy of ``sourceRobot``, whose transforms a script may move."""
        return create_goal(self, sourceRobot)

    def RemoveGoalStateRobot(self) -> bool:
        """Remove the copy."""
        return remove_goal(self)

    def GetLinkNames(self) -> tuple[str, ...]:
        """Names of the links, the root first; empty before the description is received."""
        return () if self._links is None else tuple(self._links.nodes)

    def link_nodes(self) -> dict[str, Any]:
        """Transform node of each link, in its parent's frame; empty without a description."""
        return {} if self._links is None else dict(self._links.nodes)

    def IsStale(self) -> bool:
        """True before the robot is built, and while any link has no valid pose."""
        return self._is_stale

    def GetProblem(self) -> str:
        """Problem of the description or the poses; empty if there is none."""
        if self._links is None:
            return "" if self._description is None else self._description.problem
        return self._links.problem()

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The robot's name."""
        return (names[0],)

    def status(self) -> str:
        """The problem, or the number of links."""
        return self.GetProblem() or f"{len(self.GetLinkNames())} links"

    def spin(self) -> None:
        """Build the robot for a new description, move its links and update its colour.

        Rebuilds it also when a link was removed from the scene or its surface changed.
        """
        described = self._described.take(0.0)
        is_lost = self._links is not None and not self._links.is_whole()
        robot = described or (self._robot if is_lost else None)
        if robot is not None:
            self._clear()
            self._robot = None
            self._build(robot)
            self._robot = robot
        if self._links is None:
            return
        is_stale = self._links.spin()
        if is_stale != self._is_stale or robot is not None:
            self._is_stale = is_stale
            self._links.set_known(not is_stale)
            self.Modified()

    def settings(self) -> dict[str, Any]:
        """Source of the description and of the poses."""
        return {"source": self._source, "joint_states": self._joint_states}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set the sources."""
        self.SetDescriptionSource(settings["source"])
        self.SetJointStatesTopic(str(settings["joint_states"]))

    def _start(
        self, owner: Owner, name: str, node: str, parameter: str, fixed_frame: str, tf_prefix: str
    ) -> None:
        self._settings = RobotSettings(name, tf_prefix=tf_prefix, fixed_frame=fixed_frame)

        def described(robot: Robot) -> None:
            self._described.put(robot)
            owner.wake()

        self._description = description(
            self._source, owner.ros, self._settings, node, parameter, described
        )
        self.SetName(f"ros2:robot:{name}")

    def _stop(self) -> None:
        if self._description is not None:
            self._description.close()
            self._description = None
        self.close_moveit()
        self.RemoveGoalStateRobot()
        self._clear()
        self._robot = None

    def _build(self, robot: Robot) -> None:
        owner, settings, scene = self._owner, self._settings, self.GetScene()
        if owner is None or settings is None:
            return
        self._links = (
            JointLinks(scene, owner, settings, robot, self._joint_states)
            if self._joint_states
            else TfLinks(scene, owner, settings, robot)
        )
        if not self._joint_states:
            for node in self._links.nodes.values():
                self.AddNodeReferenceID("lookup", node.GetID())
        for model in self._links.models:
            self.AddNodeReferenceID("model", model.GetID())

    def _clear(self) -> None:
        links, self._links = self._links, None
        if links is not None:
            links.remove()
        self._is_stale = True
        self.RemoveNodeReferenceIDs("lookup")
        self.RemoveNodeReferenceIDs("model")
