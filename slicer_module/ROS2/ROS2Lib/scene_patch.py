"""Adds this module's classes to the methods of a scene that take the name of a class.

A scene makes and finds nodes by C++ class names, which classes written in Python do not have.
SlicerROS2's scripts call ``slicer.mrmlScene.AddNewNodeByClass("vtkMRMLROS2NodeNode")``.
"""

import weakref
from typing import Any, cast

from slicer import vtkMRMLScene
from vtkmodules.vtkCommonCore import vtkCollection

from ROS2Lib.class_names import node_class

_PREFIX = "vtkMRMLROS2"


class ScenePatch:
    """While installed, the scene's methods below know names that begin with ``vtkMRMLROS2``.

    Calls for other classes go to the scene's own methods unchanged.
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
