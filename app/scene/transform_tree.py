"""The tree of linear transform nodes, named as SlicerIGT names them."""

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene

from app.geometry import Transform, join_transform_name
from app.scene.convert import vtk_matrix
from app.scene.errors import SceneError

RAS = "ras"


class TransformTree:
    """A node ``CauteryToReference`` for the pose ``reference_from_cautery``, under ``reference``.

    The root is the scene's world, `RAS`. A frame has one node; the frames that hang from it follow
    when it moves.
    """

    def __init__(self, scene: vtkMRMLScene) -> None:
        self._scene = scene
        self._nodes: dict[str, vtkMRMLLinearTransformNode] = {}

    def set(self, parent_from_frame: Transform) -> vtkMRMLLinearTransformNode:
        """Put the frame ``source`` where it is in ``target``, and return its node.

        A target that has no node yet raises `SceneError`: nobody knows where it is.
        """
        target, frame = parent_from_frame.target, parent_from_frame.source
        if target != RAS and target not in self._nodes:
            raise SceneError(
                f"{join_transform_name(frame, target)} cannot be placed: frame {target!r} is not "
                f"in the scene, {', '.join(sorted({RAS, *self._nodes}))} are"
            )
        node = self._nodes.get(frame)
        if node is None:
            node = self._scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
            self._nodes[frame] = node
        name = join_transform_name(frame, target)
        if node.GetName() != name:
            node.SetName(name)
        parent = self._nodes.get(target)
        node.SetAndObserveTransformNodeID(None if parent is None else parent.GetID())
        node.SetMatrixTransformToParent(vtk_matrix(parent_from_frame))
        return node

    def node(self, frame: str) -> vtkMRMLLinearTransformNode | None:
        """The node of ``frame``, None when it was never set."""
        return self._nodes.get(frame)

    def clear(self) -> None:
        """Take every node of the tree out of the scene."""
        for node in self._nodes.values():
            self._scene.RemoveNode(node)
        self._nodes.clear()
