"""The tree of linear transform nodes, named as SlicerIGT names them."""

from collections.abc import Callable, Mapping

from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene, vtkMRMLTransformableNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Transform, join_transform_name
from app.scene.convert import is_at, vtk_matrix
from app.scene.models import remove_node
from app.scene.offscreen import SceneError
from app.scene.scene_nodes import FRAME, Batch, mark

OnEdit = Callable[[Transform], None]
OnRefused = Callable[[MarginGuardError], None]
RAS = "ras"


class EditedTransform:
    """Calls ``on_edit`` with ``target_from_source`` when a user moves ``node``.

    ``target`` is the frame of the node's parent, ``source`` that of the node. A move announced by
    `expect` is not reported, so that a pose from ROS is not sent back; nor is a move of a parent.
    ``on_refused`` gets the error for a matrix that is not rigid, for a node under another parent,
    whose frame is unknown, and for a `MarginGuardError` of ``on_edit``: VTK would only print an
    error raised in an observer.
    """

    def __init__(
        self,
        node: vtkMRMLLinearTransformNode,
        target: str,
        source: str,
        on_edit: OnEdit,
        on_refused: OnRefused,
    ) -> None:
        self.target, self.source = target, source
        self._node = node
        self._on_edit, self._on_refused = on_edit, on_refused
        self._parent_id = node.GetTransformNodeID()
        self._known = _matrix_of(node)
        self._observer: int | None = node.AddObserver(
            vtkMRMLTransformableNode.TransformModifiedEvent, self._modified
        )

    def expect(self, target_from_source: Transform) -> None:
        """Announce the next pose of the node under its present parent; it is not reported."""
        self.target = target_from_source.target
        self._parent_id = self._node.GetTransformNodeID()
        self._known = tuple(target_from_source.matrix.ravel().tolist())

    def close(self) -> None:
        """Stop watching; idempotent."""
        if self._observer is not None:
            self._node.RemoveObserver(self._observer)
            self._observer = None

    def _modified(self, *_: object) -> None:
        matrix = _matrix_of(self._node)
        if matrix == self._known:
            return
        self._known = matrix
        try:
            self._on_edit(self._placed(matrix))
        except MarginGuardError as error:
            self._on_refused(error)

    def _placed(self, matrix: tuple[float, ...]) -> Transform:
        if self._node.GetTransformNodeID() != self._parent_id:
            parent = self._node.GetParentTransformNode()
            raise SceneError(
                f"{self._node.GetName()}: parent is "
                f"{'the world' if parent is None else parent.GetName()}; expected the node of "
                f"{self.target!r}"
            )
        return Transform.from_matrix(matrix, target=self.target, source=self.source)


def _matrix_of(node: vtkMRMLLinearTransformNode) -> tuple[float, ...]:
    matrix = vtkMatrix4x4()
    node.GetMatrixTransformToParent(matrix)
    return tuple(matrix.GetData())


class TransformTree:
    """One transform node per frame, such as ``ToolToReference`` for ``reference_from_tool``.

    The root is the scene's world, `RAS`. Child frames follow their parent. A node that does not
    move notifies no observer. A node that a user has put under another parent is put back, except
    a child of the world. A new frame uses the node of its name in ``adopted``, if there is one.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch | None = None,
        adopted: Mapping[str, vtkMRMLLinearTransformNode] | None = None,
    ) -> None:
        self._scene = scene
        self._adopted = dict(adopted or {})
        self._batch = batch or Batch(scene)
        self._nodes: dict[str, vtkMRMLLinearTransformNode] = {}
        self._edges: dict[str, Transform] = {}
        self._edited: dict[str, EditedTransform] = {}

    def set(self, parent_from_frame: Transform) -> vtkMRMLLinearTransformNode:
        """Set the pose of the frame ``source`` in ``target``; return its node.

        Raises `SceneError` for a target that has no node, and for one that is below the frame.
        """
        target, frame = parent_from_frame.target, parent_from_frame.source
        if target != RAS and target not in self._nodes:
            raise SceneError(
                f"{join_transform_name(frame, target)}: frame {target!r} is not in the scene; "
                f"expected one of {', '.join(sorted({RAS, *self._nodes}))}"
            )
        node = self._nodes.get(frame)
        if node is None:
            node = self._adopted.pop(join_transform_name(frame, target), None)
            node = node or self._scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
            mark(node, FRAME)
            self._nodes[frame] = node
        self._batch.hold(node)
        self._set_parent(node, frame, target)
        matrix = vtk_matrix(parent_from_frame)
        if frame in self._edited:
            self._edited[frame].expect(parent_from_frame)
        if not is_at(node, matrix):
            node.SetMatrixTransformToParent(matrix)
        self._edges[frame] = parent_from_frame
        return node

    def remove(self, frame: str) -> None:
        """Remove the node of ``frame``, which has no frame below it; nothing without one."""
        if frame in self._edited:
            self._edited.pop(frame).close()
        self._edges.pop(frame, None)
        node = self._nodes.pop(frame, None)
        if node is not None:
            remove_node(self._scene, node)

    def restore(self) -> None:
        """Put frames that a user has moved back to where they were set.

        Children of the world and frames that are watched for edits stay where they are.
        """
        for frame, edge in self._edges.items():
            if edge.target != RAS and frame not in self._edited:
                self.set(edge)

    def node(self, frame: str) -> vtkMRMLLinearTransformNode | None:
        """The node of ``frame``, None if it was never set."""
        return self._nodes.get(frame)

    def nodes(self) -> tuple[vtkMRMLLinearTransformNode, ...]:
        """The nodes of all frames."""
        return tuple(self._nodes.values())

    def on_edit(self, frame: str, on_edit: OnEdit, on_refused: OnRefused) -> None:
        """Call back when the user, not `set`, moves the node of ``frame``; one listener per frame.

        Raises `SceneError` for a frame that is not in the scene.
        """
        if frame not in self._nodes:
            raise SceneError(
                f"frame {frame!r} is not in the scene; expected one of "
                f"{', '.join(sorted(self._nodes)) or 'none'}"
            )
        if frame in self._edited:
            self._edited[frame].close()
        target = self._edges[frame].target
        self._edited[frame] = EditedTransform(
            self._nodes[frame], target, frame, on_edit, on_refused
        )

    def clear(self) -> None:
        """Remove all nodes of the tree from the scene."""
        for edited in self._edited.values():
            edited.close()
        for node in (*self._nodes.values(), *self._adopted.values()):
            remove_node(self._scene, node)
        self._adopted.clear()
        self._nodes.clear()
        self._edges.clear()
        self._edited.clear()

    def _set_parent(self, node: vtkMRMLLinearTransformNode, frame: str, target: str) -> None:
        before, parent = self._edges.get(frame), self._nodes.get(target)
        is_new = before is None or before.target != target
        # A user may put the root under another transform, but no measured frame.
        if not is_new and (target == RAS or node.GetParentTransformNode() is parent):
            return
        above = parent
        while above is not None:
            if above is node:
                raise SceneError(
                    f"{join_transform_name(frame, target)}: frame {target!r} is below {frame!r}; "
                    "expected a tree"
                )
            above = above.GetParentTransformNode()
        if is_new:
            node.SetName(join_transform_name(frame, target))
        node.SetAndObserveTransformNodeID(None if parent is None else parent.GetID())
