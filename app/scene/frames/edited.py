"""Reports edits of a transform node by the user as `Transform`."""

from collections.abc import Callable

from slicer import vtkMRMLLinearTransformNode, vtkMRMLTransformableNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Transform
from app.scene.errors import SceneError

OnEdit = Callable[[Transform], None]
OnRefused = Callable[[MarginGuardError], None]


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
