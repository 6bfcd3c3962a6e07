"""Nodes of ours that stay as we put them, whatever a user of 3D Slicer does with them."""

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


class Upkeep:
    """Knows from what the nodes that were noted hang, and what surface the models have."""

    def __init__(self) -> None:
        self._parents: dict[vtkMRMLNode, str | None] = {}
        self._points: dict[vtkMRMLNode, vtkPoints | None] = {}

    def note(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Take these, as they are now, in the place of those before."""
        hung = [node for node in nodes if isinstance(node, vtkMRMLTransformableNode)]
        models = [node for node in hung if isinstance(node, vtkMRMLModelNode)]
        self._parents = {node: node.GetTransformNodeID() for node in hung}
        self._points = {model: _points(model) for model in models}

    def restore(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Hang back what was noted and hangs elsewhere now.

        Raises `SceneError`, which names it, for one of ``nodes`` that is in no scene any more or
        has no display, and for a model with another surface, as after its transform was hardened.
        """
        for node in nodes:
            if node.GetScene() is None:
                raise _changed(node, "node", "taken out of the scene")
            if isinstance(node, _DISPLAYED) and node.GetDisplayNode() is None:
                raise _changed(node, "the display of node", "taken out of the scene")
            if node in self._points and _points(node) is not self._points[node]:
                raise _changed(node, "the surface of node", "changed")
            if node in self._parents and node.GetTransformNodeID() != self._parents[node]:
                node.SetAndObserveTransformNodeID(self._parents[node])


def _points(model: vtkMRMLModelNode) -> vtkPoints | None:
    """Others after all that replaces a surface, as hardening does, although in the same surface."""
    surface = model.GetPolyData()
    return None if surface is None else surface.GetPoints()


def _changed(node: vtkMRMLNode, what: str, how: str) -> SceneError:
    return SceneError(
        f"{what} {node.GetName()!r} was {how} by somebody else: clear what is left and build it "
        "again"
    )
