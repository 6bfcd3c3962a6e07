"""Points of a contour in a node of Slicer's markups, with undo."""

from collections import deque
from collections.abc import Callable

import numpy as np
from slicer import vtkMRMLMarkupsFiducialNode, vtkMRMLScene, vtkMRMLTransformNode

from app.contour import MAX_POINTS
from app.geometry import FloatArray, InputError
from app.scene.workflow_models import COLOR

NAME = "TumorContour"
_MAX_UNDO = 200
_EDITS = (
    vtkMRMLMarkupsFiducialNode.PointPositionDefinedEvent,
    vtkMRMLMarkupsFiducialNode.PointRemovedEvent,
    vtkMRMLMarkupsFiducialNode.PointEndInteractionEvent,
)


class ContourPoints:
    """A list of points whose coordinates are in the frame of its parent node.

    Slicer's own tools place, drag and delete them. ``edited()`` is called after each such edit.
    """

    def __init__(
        self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode, edited: Callable[[], None]
    ) -> None:
        self._scene = scene
        self._edited = edited
        self._writing = False
        self.node = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", NAME)
        self.node.CreateDefaultDisplayNodes()
        self.node.GetDisplayNode().SetPointLabelsVisibility(False)
        self.node.GetDisplayNode().SetSelectedColor(*COLOR)
        self.node.SetAndObserveTransformNodeID(parent.GetID())
        self._history: deque[FloatArray] = deque(maxlen=_MAX_UNDO)
        self._last = self.positions_mm
        self._tags = [self.node.AddObserver(event, self._on_edit) for event in _EDITS]

    @property
    def is_in_scene(self) -> bool:
        """False after a user has deleted the node."""
        return self.node.GetScene() is not None

    @property
    def positions_mm(self) -> FloatArray:
        """Copies (n, 3) of the placed points in mm; one that is being placed is not among them."""
        defined = vtkMRMLMarkupsFiducialNode.PositionDefined
        placed = [
            self.node.GetNthControlPointPosition(index)
            for index in range(self.node.GetNumberOfControlPoints())
            if self.node.GetNthControlPointPositionStatus(index) == defined
        ]
        return np.array(placed, dtype=np.float64).reshape(-1, 3)

    @property
    def can_undo(self) -> bool:
        """True if there is an edit to undo."""
        return bool(self._history)

    def follow(self, parent: vtkMRMLTransformNode) -> None:
        """Keep the points under ``parent``, also after the display was made anew."""
        if self.node.GetParentTransformNode() is not parent:
            self.node.SetAndObserveTransformNodeID(parent.GetID())

    def replace(self, positions_mm: FloatArray) -> None:
        """Use these points (n, 3); `undo` restores those before. Raises `InputError` above 300."""
        if len(positions_mm) > MAX_POINTS:
            raise InputError(f"contour: {len(positions_mm)} points; expected at most {MAX_POINTS}")
        self._write(positions_mm)
        self._record()

    def undo(self) -> None:
        """Restore the points before the last edit."""
        if not self._history:
            raise InputError("contour: there is no change to undo; expected one")
        self._write(self._history.pop())
        self._last = self.positions_mm

    def remove(self) -> None:
        """Remove the node from the scene."""
        for tag in self._tags:
            self.node.RemoveObserver(tag)
        if self.is_in_scene:
            self._scene.RemoveNode(self.node)

    def _write(self, positions_mm: FloatArray) -> None:
        self._writing = True
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for point in positions_mm.tolist():
            self.node.AddControlPoint(point)
        self.node.EndModify(modifying)
        self._writing = False

    def _record(self) -> None:
        positions_mm = self.positions_mm
        if not np.array_equal(positions_mm, self._last):
            self._history.append(self._last)
            self._last = positions_mm

    def _on_edit(self, *_: object) -> None:
        if not self._writing:
            self._record()
            self._edited()
