"""Points where the tool was in the tumour."""

from itertools import product
from math import dist, floor

from slicer import vtkMRMLMarkupsDisplayNode, vtkMRMLScene, vtkMRMLTransformNode

from app.geometry import FloatArray
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_displayed

SPACING_MM = 1.0
MAX_MARKS = 1000
"""Slicer updates all marks when the tumour moves: 1.6 ms for this many, and 35 ms to draw them."""

MARK_COLOR = (1.0, 0.8, 1.0)
"""Nearly white with a trace of violet: it differs from the colours of all states, red included, in
luminance or in hue, also for colour-blind users (`tests/scene/margin/test_breach_markers.py`)."""

_NAME = "BreachMarkers"
_SIZE_MM = 1.4
_NEIGHBOURS = tuple(product((-1, 0, 1), repeat=3))

Point = list[float]


class BreachMarkers:
    """A node of points in the tumour's frame, at least ``spacing_mm`` apart.

    The points move with the tumour and stay until `clear`. Above `MAX_MARKS` points ``spacing_mm``
    is doubled and points nearer than that to an earlier one are removed: each breach still has a
    mark within twice the spacing.
    """

    def __init__(self, scene: vtkMRMLScene, batch: Batch, tumor_pose: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self._batch = batch
        self._cells: dict[tuple[int, ...], list[Point]] = {}
        self.spacing_mm = SPACING_MM
        self.node = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", _NAME)
        self.node.SetAndObserveTransformNodeID(tumor_pose.GetID())
        self.node.SetLocked(True)
        self.node.CreateDefaultDisplayNodes()
        display = self.node.GetDisplayNode()
        display.SetSelectedColor(*MARK_COLOR)
        display.SetColor(*MARK_COLOR)
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(_SIZE_MM)
        display.SetPropertiesLabelVisibility(False)
        display.SetPointLabelsVisibility(False)

    def __len__(self) -> int:
        return int(self.node.GetNumberOfControlPoints())

    def add(self, point_mm: FloatArray) -> bool:
        """Mark ``point_mm`` (3,) in the tumour's frame; False if another mark is too near."""
        point = point_mm.tolist()
        if not self._take(point):
            return False
        self._batch.hold(self.node)
        self.node.AddControlPoint(point)
        if len(self) > MAX_MARKS:
            self._thin()
        return True

    def clear(self) -> None:
        """Remove all marks; the node stays."""
        self._cells.clear()
        self.spacing_mm = SPACING_MM
        self.node.RemoveAllControlPoints()

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)

    def _take(self, point: Point) -> bool:
        """True if ``point`` is far enough from all marks; it is recorded as one then."""
        cell = [floor(value / self.spacing_mm) for value in point]
        for offset in _NEIGHBOURS:
            near = tuple(a + b for a, b in zip(cell, offset, strict=True))
            if any(dist(point, other) < self.spacing_mm for other in self._cells.get(near, ())):
                return False
        self._cells.setdefault(tuple(cell), []).append(point)
        return True

    def _thin(self) -> None:
        marks = [list(self.node.GetNthControlPointPosition(index)) for index in range(len(self))]
        while len(marks) > MAX_MARKS:
            self.spacing_mm *= 2.0
            self._cells.clear()
            marks = [mark for mark in marks if self._take(mark)]
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for mark in marks:
            self.node.AddControlPoint(mark)
        self.node.EndModify(modifying)
