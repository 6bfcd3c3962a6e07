"""Logic of the module for scripts: the default ROS node, robots and spinning."""

import time
from collections.abc import Callable, Iterator
from typing import Any

from slicer import vtkMRMLScene

from app.geometry import MarginGuardError
from ROS2Lib.class_names import ScenePatch, node_class
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.robot import PARAMETER, vtkMRMLROS2RobotNode
from ROS2Lib.scene_loader import SceneLoader
from ROS2Lib.service_nodes import vtkMRMLROS2ServiceClientNode

DEFAULT_NODE = "slicer"
_POLL_S = 0.02


class Ros2Api:
    """Logic of the module for one ``scene``.

    Until `Close` the scene also makes and finds nodes by the class names of SlicerROS2
    (`ScenePatch`), and nodes of a scene that is loaded join the ROS graph (`SceneLoader`).

    ``received()`` is called in any thread when data wait for `Spin`, once `Spin` has been called
    after the creation of the ROS node that has received them.
    """

    def __init__(self, scene: vtkMRMLScene, received: Callable[[], None] | None = None) -> None:
        self.scene = scene
        self._patch = ScenePatch(scene)
        self._loader = SceneLoader(scene, self.GetDefaultROS2Node)
        self._received = received

    def GetDefaultROS2Node(self) -> vtkMRMLROS2NodeNode:
        """The ROS node ``slicer``, created on first use.

        Raises `MarginGuardError` if it cannot be created; the scene then stays unchanged.
        """
        for node in self.nodes():
            if node.GetROS2NodeName() == DEFAULT_NODE and node.IsCreated():
                return node
        made = vtkMRMLROS2NodeNode()
        made.SaveWithSceneOff()  # it is made when the module starts
        self.scene.AddNode(made)
        try:
            made.Create(DEFAULT_NODE)
        except MarginGuardError:
            self.scene.RemoveNode(made)
            raise
        return made

    def AddNewNodeByClass(self, className: str, name: str = "") -> Any:
        """Add a new node like the scene, for classes of this module that the scene cannot make."""
        node = node_class(className)()
        if name:
            node.SetName(name)
        self.scene.AddNode(node)
        return node

    def Spin(self) -> None:
        """Bring what has come into the scene, for every ROS node in it; often, in its thread."""
        for node in self.nodes():
            if self._received is not None:
                node.call_when_received(self._received)
            node.Spin()

    def AddRobot(
        self,
        robotName: str,
        parameterNodeName: str,
        parameterName: str = "robot_description",
        fixedFrame: str = "",
        tfPrefix: str = "",
        source: str = PARAMETER,
        jointStates: str = "",
    ) -> vtkMRMLROS2RobotNode | None:
        """Add a robot to the default node; see `vtkMRMLROS2NodeNode.CreateAndAddRobotNode`."""
        return self.GetDefaultROS2Node().CreateAndAddRobotNode(
            robotName, parameterNodeName, parameterName, fixedFrame, tfPrefix, source, jointStates
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

    def Close(self) -> None:
        """`Destroy`, and undo the changes to the scene object. Idempotent."""
        self.Destroy()
        self._patch.remove()
        self._loader.close()

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
        # The methods of the class: those of the object are `ScenePatch`'s.
        name = "vtkMRMLScriptedModuleNode"
        count = vtkMRMLScene.GetNumberOfNodesByClass(self.scene, name)
        each = [vtkMRMLScene.GetNthNodeByClass(self.scene, n, name) for n in range(count)]
        return (node for node in each if isinstance(node, vtkMRMLROS2NodeNode))
