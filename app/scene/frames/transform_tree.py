"""The tree of linear transform nodes, named as SlicerIGT names them."""

from collections.abc import Mapping

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene

from app.geometry import Transform, join_transform_name
from app.scene.errors import SceneError
from app.scene.frames.edited import EditedTransform, OnEdit, OnRefused
from app.scene.nodes.adopted_nodes import FRAME, mark
from app.scene.nodes.batch import Batch
from app.scene.nodes.convert import is_at, vtk_matrix
from app.scene.nodes.models import remove_node

RAS = "ras"


class TransformTree:
    """A node ``CauteryToReference`` for the pose ``reference_from_cautery``, under ``reference``.

    The root is the scene's world, `RAS`. A frame has one node; the frames that hang from it follow
    when it moves. A node that is put where it is already tells nobody; one that somebody hung
    elsewhere comes back, but for those of the world. A frame that has none of its own yet takes
    the node of that name in ``earlier``, if there is one.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch | None = None,
        earlier: Mapping[str, vtkMRMLLinearTransformNode] | None = None,
    ) -> None:
        self._scene = scene
        self._earlier = dict(earlier or {})
        self._batch = batch or Batch(scene)
        self._nodes: dict[str, vtkMRMLLinearTransformNode] = {}
        self._edges: dict[str, Transform] = {}
        self._edited: dict[str, EditedTransform] = {}

    def set(self, parent_from_frame: Transform) -> vtkMRMLLinearTransformNode:
        """Put the frame ``source`` where it is in ``target``, and return its node.

        A target that has no node yet raises `SceneError`: nobody knows where it is; and so does one
        that hangs from the frame itself.
        """
        target, frame = parent_from_frame.target, parent_from_frame.source
        if target != RAS and target not in self._nodes:
            raise SceneError(
                f"{join_transform_name(frame, target)} cannot be placed: frame {target!r} is not "
                f"in the scene, {', '.join(sorted({RAS, *self._nodes}))} are"
            )
        node = self._nodes.get(frame)
        if node is None:
            node = self._earlier.pop(join_transform_name(frame, target), None)
            node = node or self._scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
            mark(node, FRAME)
            self._nodes[frame] = node
        self._batch.hold(node)
        self._hang(node, frame, target)
        matrix = vtk_matrix(parent_from_frame)
        if frame in self._edited:
            self._edited[frame].expect(parent_from_frame)
        if not is_at(node, matrix):
            node.SetMatrixTransformToParent(matrix)
        self._edges[frame] = parent_from_frame
        return node

    def restore(self) -> None:
        """Put the frames that somebody else has moved back to where they were set.

        Those of the world stay where they are, and those that are watched for edits.
        """
        for frame, edge in self._edges.items():
            if edge.target != RAS and frame not in self._edited:
                self.set(edge)

    def node(self, frame: str) -> vtkMRMLLinearTransformNode | None:
        """The node of ``frame``, None when it was never set."""
        return self._nodes.get(frame)

    def nodes(self) -> tuple[vtkMRMLLinearTransformNode, ...]:
        """The nodes of all frames."""
        return tuple(self._nodes.values())

    def on_edit(self, frame: str, on_edit: OnEdit, on_refused: OnRefused) -> None:
        """Call back when the user, not `set`, moves the node of ``frame``; one listener a frame.

        Raises `SceneError` for a frame that is not in the scene.
        """
        if frame not in self._nodes:
            raise SceneError(
                f"frame {frame!r} cannot be watched: it is not in the scene, "
                f"{', '.join(sorted(self._nodes)) or 'none'} are"
            )
        if frame in self._edited:
            self._edited[frame].close()
        target = self._edges[frame].target
        self._edited[frame] = EditedTransform(
            self._nodes[frame], target, frame, on_edit, on_refused
        )

    def clear(self) -> None:
        """Take every node of the tree out of the scene."""
        for edited in self._edited.values():
            edited.close()
        for node in (*self._nodes.values(), *self._earlier.values()):
            remove_node(self._scene, node)
        self._earlier.clear()
        self._nodes.clear()
        self._edges.clear()
        self._edited.clear()

    def _hang(self, node: vtkMRMLLinearTransformNode, frame: str, target: str) -> None:
        before, parent = self._edges.get(frame), self._nodes.get(target)
        is_new = before is None or before.target != target
        # The root is the user's to hang under a transform of theirs; what we measured is not.
        if not is_new and (target == RAS or node.GetParentTransformNode() is parent):
            return
        above = parent
        while above is not None:
            if above is node:
                raise SceneError(
                    f"{join_transform_name(frame, target)} cannot be placed: frame {target!r} "
                    f"hangs from {frame!r}"
                )
            above = above.GetParentTransformNode()
        if is_new:
            node.SetName(join_transform_name(frame, target))
        node.SetAndObserveTransformNodeID(None if parent is None else parent.GetID())
