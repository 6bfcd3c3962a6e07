"""Red points where the tool was in the tumour."""

from itertools import product
from math import dist, floor

from slicer import vtkMRMLMarkupsDisplayNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import MarginState
from app.geometry import FloatArray
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_displayed

SPACING_MM = 1.0
MOST_MARKS = 1000
"""Slicer places all of them anew when the tumour moves: 1.6 ms for as many, and 35 ms to draw."""

_NAME = "BreachMarkers"
_SIZE_MM = 1.0
_NEIGHBOURS = tuple(product((-1, 0, 1), repeat=3))

Point = list[float]


class BreachMarkers:
    """A node of points in the tumour's frame, no two of them nearer than ``spacing_mm``.

    They stay with the tumour when it moves, until `clear`. `MOST_MARKS` at most: where one more is
    wanted, ``spacing_mm`` is doubled, and what is nearer than that to an earlier mark goes. A
    breach has a mark within twice the spacing, whatever was thinned.
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
        display.SetSelectedColor(*MarginState.POSITIVE.color)
        display.SetColor(*MarginState.POSITIVE.color)
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(_SIZE_MM)
        display.SetPropertiesLabelVisibility(False)
        display.SetPointLabelsVisibility(False)

    def __len__(self) -> int:
        return int(self.node.GetNumberOfControlPoints())

    def add(self, point_mm: FloatArray) -> bool:
        """Mark ``point_mm`` (3,) in the tumour's frame; False where a mark is near already."""
        point = point_mm.tolist()
        if not self._take(point):
            return False
        self._batch.hold(self.node)
        self.node.AddControlPoint(point)
        if len(self) > MOST_MARKS:
            self._thin()
        return True

    def clear(self) -> None:
        """Take all marks away; the node stays."""
        self._cells.clear()
        self.spacing_mm = SPACING_MM
        self.node.RemoveAllControlPoints()

    def remove(self) -> None:
        """Take the node out of the scene."""
        remove_displayed(self._scene, self.node)

    def _take(self, point: Point) -> bool:
        """Whether ``point`` is far enough from all before, which it is one of then."""
        cell = [floor(value / self.spacing_mm) for value in point]
        for step in _NEIGHBOURS:
            near = tuple(a + b for a, b in zip(cell, step, strict=True))
            if any(dist(point, other) < self.spacing_mm for other in self._cells.get(near, ())):
                return False
        self._cells.setdefault(tuple(cell), []).append(point)
        return True

    def _thin(self) -> None:
        marks = [list(self.node.GetNthControlPointPosition(place)) for place in range(len(self))]
        while len(marks) > MOST_MARKS:
            self.spacing_mm *= 2.0
            self._cells.clear()
            marks = [mark for mark in marks if self._take(mark)]
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for mark in marks:
            self.node.AddControlPoint(mark)
        self.node.EndModify(modifying)
