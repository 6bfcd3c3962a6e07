"""Detects and repairs what a user of 3D Slicer has done to our nodes."""

from collections.abc import Iterable

from slicer import (
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLTransformableNode,
)
from vtkmodules.vtkCommonCore import vtkPoints

from app.scene.errors import SceneError

_DISPLAYED = (vtkMRMLModelNode, vtkMRMLMarkupsNode)


class NodeIntegrity:
    """Compares nodes with their recorded parents and surfaces."""

    def __init__(self) -> None:
        self._parents: dict[vtkMRMLNode, str | None] = {}
        self._points: dict[vtkMRMLNode, vtkPoints | None] = {}

    def record(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Record ``nodes`` as they are now, instead of those recorded before."""
        placed = [node for node in nodes if isinstance(node, vtkMRMLTransformableNode)]
        models = [node for node in placed if isinstance(node, vtkMRMLModelNode)]
        self._parents = {node: node.GetTransformNodeID() for node in placed}
        self._points = {model: _points(model) for model in models}

    def restore(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Put each of ``nodes`` back under its recorded parent.

        Raises `SceneError`, which names the node, if a node or its display was removed from the
        scene, or if a model has another surface, as after its transform was hardened.
        """
        for node in nodes:
            if node.GetScene() is None:
                raise _changed(node, "node", "removed from the scene")
            if isinstance(node, _DISPLAYED) and node.GetDisplayNode() is None:
                raise _changed(node, "the display of node", "removed from the scene")
            if node in self._points and _points(node) is not self._points[node]:
                raise _changed(node, "the surface of node", "replaced")
            if node in self._parents and node.GetTransformNodeID() != self._parents[node]:
                node.SetAndObserveTransformNodeID(self._parents[node])


def _points(model: vtkMRMLModelNode) -> vtkPoints | None:
    """The points of the surface: hardening replaces them, but keeps the surface object."""
    surface = model.GetPolyData()
    return None if surface is None else surface.GetPoints()


def _changed(node: vtkMRMLNode, what: str, how: str) -> SceneError:
    return SceneError(
        f"{what} {node.GetName()!r} was {how} outside of MarginGuard; expected it unchanged: "
        "clear the scene and build it again"
    )
