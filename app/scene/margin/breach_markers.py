"""Points where the tool was in the tumour."""

from dataclasses import dataclass

from slicer import vtkMRMLMarkupsDisplayNode, vtkMRMLScene, vtkMRMLTransformNode

from app.geometry import FloatArray
from app.scene.errors import SceneError
from app.scene.margin.spaced_points import Point, SpacedPoints
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_displayed

MIN_SPACING_MM, MAX_SPACING_MM = 0.2, 20.0
MIN_SIZE_MM, MAX_SIZE_MM = 0.2, 10.0
MAX_MARKS = 1000
"""Slicer updates all marks when the tumour moves: 1.6 ms for this many, and 35 ms to draw them."""
MAX_KEPT = 20_000
"""Points that are kept for a smaller spacing."""

MARK_COLOR = (1.0, 0.8, 1.0)
"""Nearly white with a trace of violet: it differs from the colours of all states, red included, in
luminance or in hue, also for colour-blind users (`tests/scene/margin/test_breach_markers.py`)."""

_NAME = "BreachMarkers"


@dataclass(frozen=True, slots=True)
class MarkerStyle:
    """Style of breach markers: their least distance and their diameter in mm.

    Display only: breaches are counted without it. Raises `SceneError` outside of the limits.
    """

    spacing_mm: float = 1.0
    size_mm: float = 1.4

    def __post_init__(self) -> None:
        for name, value, least, largest in (
            ("least distance", self.spacing_mm, MIN_SPACING_MM, MAX_SPACING_MM),
            ("size", self.size_mm, MIN_SIZE_MM, MAX_SIZE_MM),
        ):
            if not least <= value <= largest:
                raise SceneError(
                    f"breach markers: {name} {value:g} mm; expected {least:g} to {largest:g} mm"
                )


class BreachMarkers:
    """A node of points in the tumour's frame, at least ``style.spacing_mm`` apart.

    The points move with the tumour and stay until `clear`. Above `MAX_MARKS` points the spacing is
    doubled and points nearer than that to an earlier one are removed: each breach still has a mark
    within twice the spacing. `MAX_KEPT` points are kept in the same way, at `MIN_SPACING_MM`, so
    that another style applies to earlier breaches, too.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch,
        tumor_pose: vtkMRMLTransformNode,
        style: MarkerStyle | None = None,
    ) -> None:
        self._scene = scene
        self._batch = batch
        self._style = style or MarkerStyle()
        self._kept = SpacedPoints(MIN_SPACING_MM, MAX_KEPT)
        self._marks = SpacedPoints(self._style.spacing_mm, MAX_MARKS)
        self.node = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", _NAME)
        self.node.SetAndObserveTransformNodeID(tumor_pose.GetID())
        self.node.SetLocked(True)
        self.node.CreateDefaultDisplayNodes()
        display = self.node.GetDisplayNode()
        display.SetSelectedColor(*MARK_COLOR)
        display.SetColor(*MARK_COLOR)
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(self._style.size_mm)
        display.SetPropertiesLabelVisibility(False)
        display.SetPointLabelsVisibility(False)

    def __len__(self) -> int:
        return int(self.node.GetNumberOfControlPoints())

    @property
    def style(self) -> MarkerStyle:
        """The style that is shown."""
        return self._style

    @property
    def spacing_mm(self) -> float:
        """Least distance of two marks: that of the style, or larger for many marks."""
        return self._marks.spacing_mm

    def add(self, point_mm: FloatArray) -> bool:
        """Mark ``point_mm`` (3,) in the tumour's frame; False if another mark is too near."""
        point: Point = point_mm.tolist()
        self._kept.add(point)
        before = self._marks.spacing_mm
        if not self._marks.add(point):
            return False
        self._batch.hold(self.node)
        if self._marks.spacing_mm == before:
            self.node.AddControlPoint(point)
        else:
            self._redraw()
        return True

    def set_style(self, style: MarkerStyle) -> None:
        """Show ``style``, also for the breaches so far."""
        if style == self._style:
            return
        self._style = style
        self.node.GetDisplayNode().SetGlyphSize(style.size_mm)
        self._marks = SpacedPoints(style.spacing_mm, MAX_MARKS)
        for point in self._kept.points:
            self._marks.add(point)
        self._redraw()

    def clear(self) -> None:
        """Remove all marks; the node stays."""
        self._kept = SpacedPoints(MIN_SPACING_MM, MAX_KEPT)
        self._marks = SpacedPoints(self._style.spacing_mm, MAX_MARKS)
        self.node.RemoveAllControlPoints()

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)

    def _redraw(self) -> None:
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for mark in self._marks.points:
            self.node.AddControlPoint(mark)
        self.node.EndModify(modifying)
