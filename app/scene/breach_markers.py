"""Red points where the tool was in the tumour."""

from itertools import product
from math import floor

from slicer import vtkMRMLMarkupsDisplayNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import MarginState
from app.geometry import FloatArray
from app.scene.models import remove_displayed

SPACING_MM = 1.0
_NAME = "BreachMarkers"
_SIZE_MM = 1.0
_NEIGHBOURS = tuple(product((-1, 0, 1), repeat=3))


class BreachMarkers:
    """A node of points in the tumour's frame, no two of them nearer than `SPACING_MM`.

    They stay with the tumour when it moves, until `clear`.
    """

    def __init__(self, scene: vtkMRMLScene, tumor_pose: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self._cells: dict[tuple[int, ...], list[list[float]]] = {}
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
        cell = [floor(value / SPACING_MM) for value in point]
        for step in _NEIGHBOURS:
            near = tuple(a + b for a, b in zip(cell, step, strict=True))
            for other in self._cells.get(near, ()):
                if sum((a - b) ** 2 for a, b in zip(point, other, strict=True)) < SPACING_MM**2:
                    return False
        self._cells.setdefault(tuple(cell), []).append(point)
        self.node.AddControlPoint(point)
        return True

    def clear(self) -> None:
        """Take all marks away; the node stays."""
        self._cells.clear()
        self.node.RemoveAllControlPoints()

    def remove(self) -> None:
        """Take the node out of the scene."""
        remove_displayed(self._scene, self.node)
