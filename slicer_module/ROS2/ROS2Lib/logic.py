"""Logic of the module for scripts: the default ROS node, robots and spinning."""

import time
from collections.abc import Iterator
from typing import Any

from slicer import vtkMRMLScene

from app.geometry import MarginGuardError
from ROS2Lib.classes import kind_class
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import SERVICES, TOPICS
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.publisher import vtkMRMLROS2PublisherNode
from ROS2Lib.robot import vtkMRMLROS2RobotNode
from ROS2Lib.service_client import vtkMRMLROS2ServiceClientNode
from ROS2Lib.subscriber import vtkMRMLROS2SubscriberNode
from ROS2Lib.tf2_broadcaster import vtkMRMLROS2Tf2BroadcasterNode
from ROS2Lib.tf2_lookup import vtkMRMLROS2Tf2LookupNode

DEFAULT_NODE = "slicer"
_POLL_S = 0.02

_CLASSES = (
    vtkMRMLROS2NodeNode,
    vtkMRMLROS2ParameterNode,
    vtkMRMLROS2RobotNode,
    vtkMRMLROS2Tf2BroadcasterNode,
    vtkMRMLROS2Tf2LookupNode,
)
_CLASS_FAMILIES = (
    vtkMRMLROS2PublisherNode,
    vtkMRMLROS2SubscriberNode,
    vtkMRMLROS2ServiceClientNode,
)


def node_class(name: str) -> type:
    """Node class by its name in SlicerROS2; raises `Ros2Error` for an unknown name."""
    for each in _CLASSES:
        if name == each.__name__:
            return each
    for base in _CLASS_FAMILIES:
        prefix = base.__name__.removesuffix("Node")
        if name.startswith(prefix) and name.endswith("Node") and name != base.__name__:
            return kind_class(base, name)
    raise Ros2Error(f"{name!r} is no class of the ROS2 module")


def register_classes(namespace: Any) -> None:
    """Add all classes to ``namespace`` (``slicer``), where scripts expect those of C++ modules."""
    for each in _CLASSES:
        setattr(namespace, each.__name__, each)
    for base, names in zip(_CLASS_FAMILIES, (TOPICS, TOPICS, SERVICES), strict=True):
        for name in names:
            made = kind_class(base, name)
            setattr(namespace, made.__name__, made)


class Ros2Api:
    """Logic of the module for one ``scene``."""

    def __init__(self, scene: vtkMRMLScene) -> None:
        self.scene = scene

    def GetDefaultROS2Node(self) -> vtkMRMLROS2NodeNode:
        """The ROS node ``slicer``, created on first use.

        Raises `MarginGuardError` if it cannot be created; the scene then stays unchanged.
        """
        for node in self.nodes():
            if node.GetROS2NodeName() == DEFAULT_NODE:
                return node
        made = vtkMRMLROS2NodeNode()
        self.scene.AddNode(made)
        try:
            made.Create(DEFAULT_NODE)
        except MarginGuardError:
            self.scene.RemoveNode(made)
            raise
        return made

    def AddNewNodeByClass(self, className: str, name: str = "") -> Any:
        """As the scene's own, for classes of this module, which the scene cannot make."""
        node = node_class(className)()
        if name:
            node.SetName(name)
        self.scene.AddNode(node)
        return node

    def Spin(self) -> None:
        """Bring what has come into the scene, for every ROS node in it; often, in its thread."""
        for node in self.nodes():
            node.Spin()

    def AddRobot(
        self,
        robotName: str,
        parameterNodeName: str,
        parameterName: str = "robot_description",
        fixedFrame: str = "",
        tfPrefix: str = "",
    ) -> vtkMRMLROS2RobotNode | None:
        """Add a robot to the default node; see `vtkMRMLROS2NodeNode.CreateAndAddRobotNode`."""
        return self.GetDefaultROS2Node().CreateAndAddRobotNode(
            robotName, parameterNodeName, parameterName, fixedFrame, tfPrefix
        )

    def RemoveRobot(self, robotName: str) -> bool:
        """Remove a robot of the default node; False if there is none."""
        return self.GetDefaultROS2Node().RemoveAndDeleteRobotNode(robotName)

    def WaitForServiceResponse(
        self, client: vtkMRMLROS2ServiceClientNode, timeoutSec: float
    ) -> bool:
        """Spin until the last request ends, at most ``timeoutSec``; True if it was answered."""
        until = time.monotonic() + timeoutSec
        while client.IsRequestInProgress() and time.monotonic() < until:
            client.wait(min(_POLL_S, max(0.0, until - time.monotonic())))
            self.Spin()
            client.spin()  # `Spin` skips this client if its own observer waits
        return client.GetLastResponseStatus()

    def Destroy(self) -> None:
        """Remove all ROS nodes from the scene. Idempotent."""
        for node in tuple(self.nodes()):
            node.Destroy()

    def listing(self) -> str:
        """ROS nodes and members with their status, one per line."""
        lines = []
        for node in self.nodes():
            lines.append(node.GetName())
            lines += [f"    {each.GetName()}: {each.status()}" for each in node.members]
        return "\n".join(lines)

    def nodes(self) -> Iterator[vtkMRMLROS2NodeNode]:
        """The ROS nodes in the scene."""
        # Not `GetNodesByClass`: the collection that it returns is never freed.
        count = self.scene.GetNumberOfNodesByClass("vtkMRMLScriptedModuleNode")
        each = [self.scene.GetNthNodeByClass(n, "vtkMRMLScriptedModuleNode") for n in range(count)]
        return (node for node in each if isinstance(node, vtkMRMLROS2NodeNode))
