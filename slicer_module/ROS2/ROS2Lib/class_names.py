"""Classes of this module by the names of SlicerROS2, for scripts and the methods of a scene."""

import weakref
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, cast

from slicer import vtkMRMLScene
from vtkmodules.vtkCommonCore import vtkCollection

from app.bridge.ros_errors import UnknownTypeError
from ROS2Lib.kinds import SERVICES, TOPICS, kind_class, kind_of, service_kind
from ROS2Lib.member import Ros2Error
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.robot import vtkMRMLROS2RobotNode
from ROS2Lib.ros_message import RosMessage, classes_within, vtkBoolString
from ROS2Lib.service_nodes import vtkMRMLROS2ServiceClientNode
from ROS2Lib.tf2_nodes import vtkMRMLROS2Tf2BroadcasterNode, vtkMRMLROS2Tf2LookupNode
from ROS2Lib.topic_nodes import vtkMRMLROS2PublisherNode, vtkMRMLROS2SubscriberNode

CLASSES = (
    vtkMRMLROS2NodeNode,
    vtkMRMLROS2ParameterNode,
    vtkMRMLROS2RobotNode,
    vtkMRMLROS2Tf2BroadcasterNode,
    vtkMRMLROS2Tf2LookupNode,
)
FAMILIES = (
    vtkMRMLROS2PublisherNode,
    vtkMRMLROS2SubscriberNode,
    vtkMRMLROS2ServiceClientNode,
)


def node_class(name: str) -> type:
    """Node class by its name in SlicerROS2; raises `Ros2Error` for an unknown name."""
    for each in CLASSES:
        if name == each.__name__:
            return each
    for base in FAMILIES:
        prefix = base.__name__.removesuffix("Node")
        if name.startswith(prefix) and name.endswith("Node") and name != base.__name__:
            return kind_class(base, name)
    raise Ros2Error(f"{name!r} is no class of the ROS2 module")


def register_classes(namespace: Any) -> None:
    """Add all classes to ``namespace`` (``slicer``), where scripts expect those of C++ modules.

    Besides the nodes these are the base classes of publishers, subscribers and service clients, and
    the classes of their messages with constructors and constants (``vtkStdMsgsHeader``). Kinds
    whose ROS packages are not installed have no message classes.
    """
    for each in (*CLASSES, *FAMILIES, vtkBoolString):
        setattr(namespace, each.__name__, each)
    for base, names in zip(FAMILIES, (TOPICS, TOPICS, SERVICES), strict=True):
        for name in names:
            made = kind_class(base, name)
            setattr(namespace, made.__name__, made)
    for message in _message_classes():
        setattr(namespace, message.__name__, message)


def _message_classes() -> Iterator[type[RosMessage]]:
    for name in TOPICS:
        with suppress(UnknownTypeError):
            yield from classes_within(kind_of(name).type)
    for name in SERVICES:
        with suppress(UnknownTypeError):
            kind = service_kind(name)
            yield from (*classes_within(kind.Request), *classes_within(kind.Response))


_PREFIX = "vtkMRMLROS2"


class ScenePatch:
    """While installed, the scene's methods below know names that begin with ``vtkMRMLROS2``.

    A scene makes and finds nodes by C++ class names, which classes written in Python do not have.
    SlicerROS2's scripts call ``slicer.mrmlScene.AddNewNodeByClass("vtkMRMLROS2NodeNode")``. Calls
    for other classes go to the scene's own methods unchanged.
    """

    METHODS = (
        "AddNewNodeByClass",
        "CreateNodeByClass",
        "GetFirstNodeByClass",
        "GetNodesByClass",
        "GetNthNodeByClass",
        "GetNumberOfNodesByClass",
    )

    def __init__(self, scene: vtkMRMLScene) -> None:
        # Weak, because the scene holds these methods, and VTK collects no such cycles.
        self._scene = weakref.ref(scene)
        for name in self.METHODS:
            setattr(scene, name, getattr(self, name))

    def remove(self) -> None:
        """Restore the scene's own methods. Idempotent."""
        scene = self._scene()
        for name in self.METHODS:
            if scene is not None and vars(scene).get(name) == getattr(self, name):
                delattr(scene, name)

    def AddNewNodeByClass(self, className: str, *name: str) -> Any:
        """A new node in the scene, with ``name`` if one is given."""
        if not className.startswith(_PREFIX):
            return vtkMRMLScene.AddNewNodeByClass(self._there, className, *name)
        node = node_class(className)()
        if name:
            node.SetName(*name)
        return self._there.AddNode(node)

    def CreateNodeByClass(self, className: str) -> Any:
        """A new node that is in no scene."""
        if not className.startswith(_PREFIX):
            return vtkMRMLScene.CreateNodeByClass(self._there, className)
        return node_class(className)()

    def GetFirstNodeByClass(self, className: str) -> Any:
        """The first node of the class or of one derived from it; None without one."""
        if not className.startswith(_PREFIX):
            return vtkMRMLScene.GetFirstNodeByClass(self._there, className)
        return next(iter(self._nodes(className)), None)

    def GetNodesByClass(self, className: str) -> vtkCollection:
        """The nodes of the class and of those derived from it."""
        if not className.startswith(_PREFIX):
            return cast(vtkCollection, vtkMRMLScene.GetNodesByClass(self._there, className))
        found = vtkCollection()
        for node in self._nodes(className):
            found.AddItem(node)
        return found

    def GetNthNodeByClass(self, n: int, className: str) -> Any:
        """The n-th of these nodes; None if there are fewer."""
        if not className.startswith(_PREFIX):
            return vtkMRMLScene.GetNthNodeByClass(self._there, n, className)
        nodes = self._nodes(className)
        return nodes[n] if 0 <= n < len(nodes) else None

    def GetNumberOfNodesByClass(self, className: str) -> int:
        """Number of these nodes."""
        if not className.startswith(_PREFIX):
            return int(vtkMRMLScene.GetNumberOfNodesByClass(self._there, className))
        return len(self._nodes(className))

    def _nodes(self, class_name: str) -> list[Any]:
        scene = self._there
        each = (scene.GetNthNode(index) for index in range(scene.GetNumberOfNodes()))
        return [node for node in each if node.IsA(class_name)]

    @property
    def _there(self) -> vtkMRMLScene:
        scene = self._scene()
        if scene is None:
            raise ReferenceError("the scene was deleted")
        return scene
